// Where bodies of an arm, its tool and points on it are in many configurations, and how they move.
#include <cstdlib>

#include "chain.h"

// Poses of the base and `count` bodies: rotations (N, count + 1, 3, 3), origins (N, count + 1, 3).
TUBEPLANNER_API void tubeplanner_body_poses(const double* table, integer count, const double* q,
                                            integer n, integer samples, double* rotation,
                                            double* position) {
    const Joint* joints = reinterpret_cast<const Joint*>(table);
    for (integer s = 0; s < samples; ++s, q += n) {
        for (int i = 0; i < 9; ++i) rotation[i] = i % 4 == 0;
        for (int i = 0; i < 3; ++i) position[i] = 0;
        for (integer k = 0; k < count; ++k) {
            integer parent = integer(joints[k].parent);
            place(joints[k], q, rotation + 9 * parent, position + 3 * parent,
                  rotation + 9 * (k + 1), position + 3 * (k + 1));
        }
        rotation += 9 * (count + 1), position += 3 * (count + 1);
    }
}

// Rotations (N, 3, 3), positions (N, 3) and, unless it is null, Jacobians (N, 6, n) of the last of
// `count` bodies, each of which carries the next. Return 0, or 1 if there is no memory.
TUBEPLANNER_API int tubeplanner_last_poses(const double* table, integer count, const double* q,
                                           integer n, integer samples, double* rotation,
                                           double* position, double* jacobian) {
    double* frames = static_cast<double*>(std::malloc(6 * count * sizeof(double)));
    if (frames == nullptr) return 1;
    for (integer s = 0; s < samples; ++s)
        last_pose(reinterpret_cast<const Joint*>(table), count, n, q + n * s, frames,
                  rotation + 9 * s, position + 3 * s,
                  jacobian == nullptr ? nullptr : jacobian + 6 * n * s);
    std::free(frames);
    return 0;
}

// Jacobians (N, 3, n) of points (N, 3), each of which moves with a body (N,), from `body_poses`.
TUBEPLANNER_API void tubeplanner_point_jacobians(const double* table, integer count,
                                                 const double* rotation, const double* position,
                                                 const integer* body, const double* point,
                                                 integer n, integer samples, double* jacobian) {
    const Joint* joints = reinterpret_cast<const Joint*>(table);
    for (integer s = 0; s < samples; ++s, jacobian += 3 * n) {
        const double* turned = rotation + 9 * (count + 1) * s;
        const double* placed = position + 3 * (count + 1) * s;
        for (integer i = 0; i < 3 * n; ++i) jacobian[i] = 0;
        for (integer at = body[s]; at > 0; at = integer(joints[at - 1].parent)) {
            double axis[3];
            for (int i = 0; i < 3; ++i) axis[i] = times(turned + 9 * at, i, joints[at - 1].axis);
            add_column(joints[at - 1], axis, placed + 3 * at, point + 3 * s, n, jacobian, nullptr);
        }
    }
}
