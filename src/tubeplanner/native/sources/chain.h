// Bodies that hang from each other by joints, and where they are.
#pragma once

#include <cmath>

#include "numerics.h"
#include "vectors3.h"

// What carries a body, as rows of a table of doubles.
struct Joint {
    double parent;              // the body that carries it; body k + 1 is moved by joint k
    double planned;             // which of the n joints it is, or follows
    double turns;               // 1, or 0: it slides
    double multiplier, offset;  // where it is: multiplier q + offset
    double position[3];         // of its body's origin in the parent, at zero
    double axis[3];             // in its body
    double along[3];            // its axis in the parent
    // Its body's rotation in the parent at an angle a: placed + sin a across + (1 - cos a) twice.
    double placed[9], across[9], twice[9];
};

// Return row `row` of a matrix (., 3) times a vector.
inline double times(const double* matrix, int row, const double* v) {
    return matrix[3 * row] * v[0] + matrix[3 * row + 1] * v[1] + matrix[3 * row + 2] * v[2];
}

// Set the pose of a joint's body from that of the body that carries it.
inline void place(const Joint& joint, const double* q, const double* carrier, const double* origin,
                  double* rotation, double* position) {
    double value = joint.multiplier * q[integer(joint.planned)] + joint.offset;
    double angle = joint.turns != 0 ? value : 0.0, travel = value - angle;
    double sine = std::sin(angle), rest = 1 - std::cos(angle), turned[9], moved[3];
    for (int k = 0; k < 9; ++k)
        turned[k] = joint.placed[k] + sine * joint.across[k] + rest * joint.twice[k];
    for (int k = 0; k < 3; ++k) moved[k] = joint.position[k] + travel * joint.along[k];
    for (int i = 0; i < 3; ++i) {
        position[i] = origin[i] + times(carrier, i, moved);
        for (int j = 0; j < 3; ++j)
            rotation[3 * i + j] = carrier[3 * i] * turned[j] + carrier[3 * i + 1] * turned[3 + j] +
                                  carrier[3 * i + 2] * turned[6 + j];
    }
}

// Add how a point of a body that a joint moves goes with it, in the base frame: to column `planned`
// of a matrix (3, n), and how it turns to one below it unless that is null.
inline void add_column(const Joint& joint, const double* axis, const double* origin,
                       const double* point, integer n, double* linear, double* angular) {
    double arm[3] = {point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]}, moved[3];
    cross(axis, arm, moved);
    for (int i = 0; i < 3; ++i) {
        integer at = i * n + integer(joint.planned);
        linear[at] += joint.multiplier * (joint.turns != 0 ? moved[i] : axis[i]);
        if (angular != nullptr && joint.turns != 0) angular[at] += joint.multiplier * axis[i];
    }
}

// Set the pose of the last of `count` bodies, each of which carries the next, and unless it is null
// its Jacobian (6, n), linear rows first. `frames` (count, 6) is written to.
inline void last_pose(const Joint* joints, integer count, integer n, const double* q,
                      double* frames, double* rotation, double* position, double* jacobian) {
    double turned[2][9] = {{1, 0, 0, 0, 1, 0, 0, 0, 1}}, still[3] = {0, 0, 0};
    const double* origin = still;
    for (integer k = 0; k < count; ++k) {
        double *axis = frames + 6 * k, *own = turned[(k + 1) % 2];
        place(joints[k], q, turned[k % 2], origin, own, axis + 3);
        for (int i = 0; i < 3; ++i) axis[i] = times(own, i, joints[k].axis);
        origin = axis + 3;
    }
    for (int i = 0; i < 9; ++i) rotation[i] = turned[count % 2][i];
    for (int i = 0; i < 3; ++i) position[i] = origin[i];
    if (jacobian == nullptr) return;
    for (integer i = 0; i < 6 * n; ++i) jacobian[i] = 0;
    for (integer k = 0; k < count; ++k)
        if (joints[k].multiplier != 0)
            add_column(joints[k], frames + 6 * k, frames + 6 * k + 3, position, n, jacobian,
                       jacobian + 3 * n);
}
