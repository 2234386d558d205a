// Vectors of three, rotations row by row.
#pragma once

#include <cmath>

static inline double dot(const double* a, const double* b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline double length(const double* a) { return std::sqrt(dot(a, a)); }

static inline void minus(const double* a, const double* b, double* out) {
    for (int i = 0; i < 3; i++) out[i] = a[i] - b[i];
}

static inline void cross(const double* a, const double* b, double* out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void turn(const double* rotation, const double* a, double* out) {
    for (int i = 0; i < 3; i++) out[i] = dot(rotation + 3 * i, a);
}

static inline void turn_back(const double* rotation, const double* a, double* out) {
    for (int i = 0; i < 3; i++)
        out[i] = rotation[i] * a[0] + rotation[3 + i] * a[1] + rotation[6 + i] * a[2];
}
