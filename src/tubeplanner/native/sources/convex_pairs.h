// Convex shapes on bodies, a pair of them where it is, and its closest points.
#pragma once

#include "numerics.h"

// S shapes, each in its body's frame: points grown by a radius.
struct Shapes {
    integer count;
    const integer* body;
    const integer* begin;     // where a shape's numbers begin in `points`
    const integer* size;      // how many points it has, repeated ones included
    const double* points;     // of each shape its x, then its y, then its z
    const double* radius;
    const double* center;     // of the bounding sphere, three each
    const double* reach;      // its radius
    const double* axes;       // of the bounding box, nine each
    const double* middle;     // its centre along these, three each
    const double* half;       // its half lengths, three each
};

// The poses of all bodies in some configurations.
struct Poses {
    integer bodies;
    const double* rotation;
    const double* position;

    const double* turned(integer row, integer body) const {
        return rotation + 9 * (row * bodies + body);
    }
    const double* placed(integer row, integer body) const {
        return position + 3 * (row * bodies + body);
    }
};

// Two shapes' points, those of the first moved into the frame of the second one's body.
struct Pair {
    const double *first, *second;
    integer first_size, second_size;
    double turned[9], moved[3];

    Pair(const Shapes& shapes, const Poses& poses, integer row, const integer* pair);
    double apart(const double* direction, integer* ids, double* gap) const;
    void point(const integer* ids, double* of_first, double* of_second) const;
};

// How far apart a pair is, without radii, in the frame of the second one's body.
struct Closest {
    double lower, upper;  // bounds; the upper one only if no `enough` ended the search, and of an
                          // overlap only if its depth was asked for
    double direction[3];  // along which it is `lower` apart, from the first to the second
    double first[3], second[3];
};

Closest closest(const Pair& pair, const double* start, double enough, bool depth = false);
bool overlap_depth(const Pair& pair, const double corner[4][3], const integer ids[4][2],
                   Closest* found);
