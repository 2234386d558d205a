// Rotation vectors: axis times angle; rotations row by row.
//
// Counterpart of tubeplanner/orientation.py.
#pragma once

#include <cmath>

static const double SMALL_ANGLE = 1e-2;  // below it, a series is used

// Set A^T B.
inline void relative_rotation(const double* a, const double* b, double* product) {
    for (int i = 0; i < 9; ++i)
        product[i] = a[i / 3] * b[i % 3] + a[3 + i / 3] * b[3 + i % 3] + a[6 + i / 3] * b[6 + i % 3];
}

// Set the vector of a matrix (Shepperd: the row of 4 q q^T with the largest diagonal).
inline void rotation_vector(const double* m, double* v) {
    double rows[4][4];
    for (int i = 0; i < 3; ++i) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        rows[i][i] = 1 + m[4 * i] - m[4 * j] - m[4 * k];
        rows[i][j] = rows[j][i] = m[3 * i + j] + m[3 * j + i];
        rows[i][3] = rows[3][i] = m[3 * k + j] - m[3 * j + k];
    }
    rows[3][3] = 1 + m[0] + m[4] + m[8];
    int best = 0;
    for (int i = 1; i < 4; ++i)
        if (rows[i][i] > rows[best][best]) best = i;
    const double* x = rows[best];
    double sign = x[3] < 0 ? -1.0 : 1.0, sine = std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    double gain = sign * 2 * std::atan2(sine, sign * x[3]) / (sine == 0 ? 1 : sine);
    for (int i = 0; i < 3; ++i) v[i] = gain * x[i];
}

// Set J (3, 3) with dv/dt = J w (Sola et al., 2018, appendix B).
inline void inverse_right_jacobian(const double* v, double* matrix) {
    double squared = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], a = std::sqrt(squared);
    double c = a < SMALL_ANGLE ? 1.0 / 12 + squared / 720
                                : 1 / squared - 1 / (2 * a * std::tan(a / 2));
    for (int i = 0; i < 3; ++i) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        matrix[4 * i] = 1 - c * (v[j] * v[j] + v[k] * v[k]);
        matrix[3 * i + j] = -0.5 * v[k] + c * v[i] * v[j];
        matrix[3 * j + i] = 0.5 * v[k] + c * v[i] * v[j];
    }
}
