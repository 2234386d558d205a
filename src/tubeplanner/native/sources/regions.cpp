// Convex regions about line segments, their axes: how far points are from these, and how far behind
// supporting planes.
#include <cmath>

#include "numerics.h"

namespace {

inline double dot(const double* a, const double* b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline double farthest(const double* normal, const double* begin, const double* end) {
    return std::fmax(dot(normal, begin), dot(normal, end));
}

}  // namespace

// Vectors to points (count, 3) from the nearest points of axes, and their lengths. Points belong to
// the segments (rows) in turn; axes whose squares are less than the least count as points.
TUBEPLANNER_API void away_from_axes(integer count, const double* points, const double* begin,
                                    const double* end, integer rows, const integer* segment,
                                    double least, double* away, double* distance) {
    for (integer i = 0, row = 0; i < count; ++i, row = row + 1 == rows ? 0 : row + 1) {
        const double *a = begin + 3 * segment[row], *b = end + 3 * segment[row];
        const double axis[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
        const double *p = points + 3 * i, from[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
        const double square = dot(axis, axis);
        double share = dot(from, axis) / (square < least ? least : square);
        share = share < 0 ? 0 : share > 1 ? 1 : share;
        for (int k = 0; k < 3; ++k) away[3 * i + k] = p[k] - (a[k] + share * axis[k]);
        distance[i] = std::sqrt(dot(away + 3 * i, away + 3 * i));
    }
}

// How far behind planes their samples' points are, as shares of the extents of the samples' own
// regions beyond their axes. Planes hold another segment's region too, with another extent, or that
// alone.
TUBEPLANNER_API void plane_slack(integer count, const integer* sample, const double* normal,
                                 const double* points, const double* begin, const double* end,
                                 const integer* own, const integer* other, const integer* alone,
                                 const double* margin, const double* extent,
                                 const double* other_extent, double* slack) {
    for (integer p = 0; p < count; ++p, normal += 3) {
        const integer at = sample[p], segment = own[at];
        const double room = 1 - margin[at];
        const double most = farthest(normal, begin + 3 * segment, end + 3 * segment);
        slack[p] = room - (dot(normal, points + 3 * at) - most) / extent[p];
        if (other[p] == segment) continue;
        const double beyond = farthest(normal, begin + 3 * other[p], end + 3 * other[p]) - most +
                              room * (other_extent[p] - extent[p]);
        if (beyond > 0 || alone[p]) slack[p] += beyond / extent[p];
    }
}
