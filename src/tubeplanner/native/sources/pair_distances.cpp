// Bounds on the distances of pairs of convex shapes in many configurations: by spheres, by boxes,
// along directions that are known, and by closest points.
#include "convex_pairs.h"

#include <cfloat>
#include <cstring>

#include "vectors3.h"

static const double PROVEN = 1e-9;  // bounds this near each other are the distance [m]

static void place_center(const Shapes& shapes, const Poses& poses, integer row, integer shape,
                         double* out) {
    const double* origin = poses.placed(row, shapes.body[shape]);
    turn(poses.turned(row, shapes.body[shape]), shapes.center + 3 * shape, out);
    for (int i = 0; i < 3; i++) out[i] += origin[i];
}

static double sphere_gap(const Shapes& shapes, const integer* pair, const double* first,
                         const double* second) {
    double gap[3];
    minus(second, first, gap);
    return length(gap) - shapes.reach[pair[0]] - shapes.reach[pair[1]];
}

// Return how far the sphere of a shape is from the box of another.
static double from_box(const Shapes& shapes, const Poses& poses, integer row, integer box,
                       integer ball, const double* center) {
    double away[3], local[3], along[3], squared = 0;
    minus(center, poses.placed(row, shapes.body[box]), away);
    turn_back(poses.turned(row, shapes.body[box]), away, local);
    turn(shapes.axes + 9 * box, local, along);
    for (int i = 0; i < 3; i++) {
        const double beyond =
            std::fabs(along[i] - shapes.middle[3 * box + i]) - shapes.half[3 * box + i];
        if (beyond > 0) squared += beyond * beyond;
    }
    return std::sqrt(squared) - shapes.reach[ball];
}

static double box_gap(const Shapes& shapes, const Poses& poses, integer row, const integer* pair,
                      const double* first, const double* second) {
    const double one = from_box(shapes, poses, row, pair[1], pair[0], first);
    const double other = from_box(shapes, poses, row, pair[0], pair[1], second);
    return one > other ? one : other;
}

static double radii(const Shapes& shapes, const integer* pair) {
    return shapes.radius[pair[0]] + shapes.radius[pair[1]];
}

// Set a direction to begin with, from the one sphere's centre to the other's, in the frame of the
// second one's body, unless there is one.
static void begin_with(const Shapes& shapes, const Pair& pair, const integer* ids, double* out) {
    if (dot(out, out) > 0) return;
    double center[3];
    turn(pair.turned, shapes.center + 3 * ids[0], center);
    for (int i = 0; i < 3; i++) out[i] = shapes.center[3 * ids[1] + i] - center[i] - pair.moved[i];
    const double norm = length(out);
    for (int i = 0; i < 3; i++) out[i] = norm > 0 ? out[i] / norm : (i == 0);
}

static bool is_proven(const Closest& found) { return found.upper - found.lower <= PROVEN; }

// Return the closest points of a pair, which may begin with a direction; that becomes the found one.
static Closest closest_of(const Shapes& shapes, const Poses& poses, integer row,
                          const integer* ids, double* direction, double enough) {
    const Pair pair(shapes, poses, row, ids);
    begin_with(shapes, pair, ids, direction);
    const Closest found = closest(pair, direction, enough, true);
    std::memcpy(direction, found.direction, sizeof found.direction);
    return found;
}

static void place_centers(const Shapes& shapes, const Poses& poses, integer row, double* centers) {
    for (integer s = 0; s < shapes.count; s++)
        place_center(shapes, poses, row, s, centers + 3 * s);
}

// Lower bounds from spheres, configurations by pairs; room for all centres.
TUBEPLANNER_API void tubeplanner_sphere_gaps(const Shapes* shapes, integer bodies,
                                             const double* rotation, const double* position,
                                             integer rows, integer count, const integer* pairs,
                                             double* centers, double* gaps) {
    const Poses poses{bodies, rotation, position};
    for (integer row = 0; row < rows; row++) {
        place_centers(*shapes, poses, row, centers);
        for (integer p = 0; p < count; p++) {
            const integer* pair = pairs + 2 * p;
            gaps[row * count + p] =
                sphere_gap(*shapes, pair, centers + 3 * pair[0], centers + 3 * pair[1]);
        }
    }
}

// Lower bounds of pairs, each in its own configuration, from spheres and boxes.
TUBEPLANNER_API void tubeplanner_box_gaps(const Shapes* shapes, integer bodies,
                                          const double* rotation, const double* position,
                                          integer count, const integer* row, const integer* pairs,
                                          double* gaps) {
    const Poses poses{bodies, rotation, position};
    for (integer p = 0; p < count; p++) {
        const integer* pair = pairs + 2 * p;
        double first[3], second[3];
        place_center(*shapes, poses, row[p], pair[0], first);
        place_center(*shapes, poses, row[p], pair[1], second);
        gaps[p] = box_gap(*shapes, poses, row[p], pair, first, second);
    }
}

// How far pairs are apart along directions; those whose spheres are `enough` apart, by these.
TUBEPLANNER_API void tubeplanner_gaps_along(const Shapes* shapes, integer bodies,
                                            const double* rotation, const double* position,
                                            integer count, const integer* row,
                                            const integer* pairs, const double* direction,
                                            const double* enough, double* gaps) {
    const Poses poses{bodies, rotation, position};
    for (integer p = 0; p < count; p++) {
        const integer* ids = pairs + 2 * p;
        double first[3], second[3], spheres = -DBL_MAX, way[3];
        integer ends[2];
        if (enough) {
            place_center(*shapes, poses, row[p], ids[0], first);
            place_center(*shapes, poses, row[p], ids[1], second);
            gaps[p] = spheres = sphere_gap(*shapes, ids, first, second);
            if (spheres >= enough[p]) continue;
        }
        const Pair pair(*shapes, poses, row[p], ids);
        const double apart = pair.apart(direction + 3 * p, ends, way) - radii(*shapes, ids);
        gaps[p] = apart > spheres ? apart : spheres;
    }
}

// The closest points of pairs, each in its own configuration; directions, in the frame of the
// second one's body, are what the search begins with (zero: nothing is known), and what it finds;
// `along` is the same in the base frame.
TUBEPLANNER_API void tubeplanner_closest_points(const Shapes* shapes, integer bodies,
                                                const double* rotation, const double* position,
                                                integer count, const integer* row,
                                                const integer* pairs, double* direction,
                                                double* distance, double* along, double* first,
                                                double* second, bool* proven) {
    const Poses poses{bodies, rotation, position};
    for (integer p = 0; p < count; p++) {
        const integer* ids = pairs + 2 * p;
        const Closest found = closest_of(*shapes, poses, row[p], ids, direction + 3 * p, DBL_MAX);
        const double* frame = poses.turned(row[p], shapes->body[ids[1]]);
        const double* origin = poses.placed(row[p], shapes->body[ids[1]]);
        distance[p] = found.lower - radii(*shapes, ids);
        proven[p] = is_proven(found);
        turn(frame, found.direction, along + 3 * p);
        turn(frame, found.first, first + 3 * p);
        turn(frame, found.second, second + 3 * p);
        for (int i = 0; i < 3; i++) first[3 * p + i] += origin[i], second[3 * p + i] += origin[i];
    }
}

// Distances of pairs in all configurations, exact where they are less than what matters and what
// is known says no better; directions as above, by pair, from configuration to configuration.
TUBEPLANNER_API void tubeplanner_near_distances(const Shapes* shapes, integer bodies,
                                                const double* rotation, const double* position,
                                                integer rows, integer count, const integer* pairs,
                                                const double* matters, double* centers,
                                                double* direction, double* bound, bool* open) {
    const Poses poses{bodies, rotation, position};
    for (integer row = 0; row < rows; row++) {
        place_centers(*shapes, poses, row, centers);
        for (integer p = 0; p < count; p++) {
            const integer *ids = pairs + 2 * p, at = row * count + p;
            const double *one = centers + 3 * ids[0], *other = centers + 3 * ids[1];
            const double spheres = sphere_gap(*shapes, ids, one, other);
            open[at] = false;
            bound[at] = bound[at] > spheres ? bound[at] : spheres;
            if (bound[at] >= matters[at]) continue;
            const double grown = radii(*shapes, ids), enough = matters[at] + grown;
            const Closest found =
                closest_of(*shapes, poses, row, ids, direction + 3 * p, enough);
            const double apart = found.lower - grown;
            open[at] = apart < matters[at] && !is_proven(found);
            bound[at] = apart > bound[at] ? apart : bound[at];
        }
    }
}
