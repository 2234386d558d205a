// The closest points of two sets of points' hulls, by the algorithm of Gilbert, Johnson and Keerthi
// ("A fast procedure for computing the distance between complex objects in three-dimensional
// space", 1988), with two bounds that prove each other: how far the hulls are apart along a
// direction, and the distance of two points in them.
#include "convex_pairs.h"

#include <cfloat>
#include <cstring>

#include "vectors3.h"

static const integer BLOCK = 64;      // points looked at together
static const int MOST_STEPS = 64;
static const double SETTLED = 1e-12;  // bounds this near each other are one [m]
static const double FLAT = 1e-24;     // the squared sine of a corner of a triangle without area

// Return how far a shape reaches along a direction, and which of its points does.
static double reach_along(const double* x, integer size, const double* direction, integer* id) {
    const double *y = x + size, *z = y + size;
    double best = -DBL_MAX;
    *id = 0;
    for (integer begin = 0; begin < size; begin += BLOCK) {
        double along[BLOCK], most = -DBL_MAX;
        const integer count = size - begin < BLOCK ? size - begin : BLOCK;
#pragma omp simd reduction(max : most)
        for (integer k = 0; k < count; k++) {
            const integer at = begin + k;
            along[k] = x[at] * direction[0] + y[at] * direction[1] + z[at] * direction[2];
            most = along[k] > most ? along[k] : most;
        }
        if (most <= best) continue;
        best = most;
        integer k = 0;
        while (k < count - 1 && along[k] != most) k++;
        *id = begin + k;
    }
    return best;
}

Pair::Pair(const Shapes& shapes, const Poses& poses, integer row, const integer* pair) {
    const integer one = pair[0], other = pair[1];
    first = shapes.points + shapes.begin[one], first_size = shapes.size[one];
    second = shapes.points + shapes.begin[other], second_size = shapes.size[other];
    const double* base = poses.turned(row, shapes.body[other]);
    const double* own = poses.turned(row, shapes.body[one]);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            turned[3 * i + j] =
                base[i] * own[j] + base[3 + i] * own[3 + j] + base[6 + i] * own[6 + j];
    double offset[3];
    minus(poses.placed(row, shapes.body[one]), poses.placed(row, shapes.body[other]), offset);
    turn_back(base, offset, moved);
}

// Return how far the second begins beyond the end of the first, which points these are, and the
// way from the one to the other.
double Pair::apart(const double* direction, integer* ids, double* gap) const {
    const double back[3] = {-direction[0], -direction[1], -direction[2]};
    double local[3], of_first[3], of_second[3];
    turn_back(turned, direction, local);
    const double end = reach_along(first, first_size, local, ids) + dot(moved, direction);
    const double begin = -reach_along(second, second_size, back, ids + 1);
    point(ids, of_first, of_second);
    minus(of_second, of_first, gap);
    return begin - end;
}

void Pair::point(const integer* ids, double* of_first, double* of_second) const {
    double own[3];
    for (int i = 0; i < 3; i++) {
        own[i] = first[ids[0] + i * first_size];
        of_second[i] = second[ids[1] + i * second_size];
    }
    turn(turned, own, of_first);
    for (int i = 0; i < 3; i++) of_first[i] += moved[i];
}

namespace {

// Up to four corners, and their point that is nearest to the origin.
struct Simplex {
    int count = 0;
    double corner[4][3], weight[4], nearest[3], squared = DBL_MAX;
    integer ids[4][2];

    bool has(const integer* id) const {
        for (int k = 0; k < count; k++)
            if (ids[k][0] == id[0] && ids[k][1] == id[1]) return true;
        return false;
    }

    void add(const double* gap, const integer* id) {
        std::memcpy(corner[count], gap, sizeof corner[0]);
        std::memcpy(ids[count++], id, sizeof ids[0]);
    }

    // Keep `which` corners if the point of their plane nearest to the origin is nearer than what
    // was found yet, and between them: shares are the weights of all but the first one.
    void take(const Simplex& all, const int* which, int number, const double* shares,
              const double* point) {
        double rest = 1;
        for (int k = 1; k < number; k++) {
            if (!(shares[k - 1] > 0)) return;
            rest -= shares[k - 1];
        }
        if (!(rest > 0) || !(dot(point, point) < squared)) return;
        count = 0;
        for (int k = 0; k < number; k++) {
            weight[count] = k ? shares[k - 1] : rest;
            add(all.corner[which[k]], all.ids[which[k]]);
        }
        std::memcpy(nearest, point, sizeof nearest);
        squared = dot(point, point);
    }

    void take_edge(const Simplex& all, int a, int b) {
        const double *p = all.corner[a];
        double edge[3], point[3];
        minus(all.corner[b], p, edge);
        const double share = -dot(p, edge) / dot(edge, edge);
        for (int i = 0; i < 3; i++) point[i] = p[i] + share * edge[i];
        const int which[2] = {a, b};
        take(all, which, 2, &share, point);
    }

    void take_triangle(const Simplex& all, int a, int b, int c) {
        const double *p = all.corner[a];
        double one[3], other[3], normal[3], point[3];
        minus(all.corner[b], p, one);
        minus(all.corner[c], p, other);
        cross(one, other, normal);
        const double area = dot(normal, normal), height = dot(p, normal);
        const double own = dot(one, one), both = dot(one, other), its = dot(other, other);
        if (!(area > FLAT * own * its)) return;
        const double along = -dot(p, one), across = -dot(p, other);
        const double shares[2] = {(its * along - both * across) / area,
                                  (own * across - both * along) / area};
        for (int i = 0; i < 3; i++) point[i] = normal[i] * height / area;
        const int which[3] = {a, b, c};
        take(all, which, 3, shares, point);
    }

    void take_all(const Simplex& all) {
        double edge[3][3], normal[3][3], shares[3];
        for (int k = 0; k < 3; k++) minus(all.corner[k], all.corner[3], edge[k]);
        for (int k = 0; k < 3; k++) cross(edge[(k + 1) % 3], edge[(k + 2) % 3], normal[k]);
        const double volume = dot(edge[0], normal[0]);
        for (int k = 0; k < 3; k++) shares[k] = -dot(all.corner[3], normal[k]) / volume;
        const int which[4] = {3, 0, 1, 2};
        const double origin[3] = {0, 0, 0};
        take(all, which, 4, shares, origin);
    }
};

// Return the fewest corners whose hull has the nearest point; the last one is surely among them.
Simplex reduced(const Simplex& all) {
    const int last = all.count - 1;
    Simplex found;
    found.take(all, &last, 1, nullptr, all.corner[last]);
    for (int a = 0; a < last; a++) found.take_edge(all, last, a);
    for (int a = 0; a < last; a++)
        for (int b = a + 1; b < last; b++) found.take_triangle(all, last, a, b);
    if (last == 3) found.take_all(all);
    return found;
}

void set_points(const Pair& pair, const Simplex& simplex, Closest* found) {
    double first[3], second[3], gap[3];
    for (int i = 0; i < 3; i++) found->first[i] = found->second[i] = 0;
    for (int k = 0; k < simplex.count; k++) {
        pair.point(simplex.ids[k], first, second);
        for (int i = 0; i < 3; i++) {
            found->first[i] += simplex.weight[k] * first[i];
            found->second[i] += simplex.weight[k] * second[i];
        }
    }
    minus(found->second, found->first, gap);
    found->upper = length(gap);
}

}  // namespace

// Return the closest points of a pair, from a unit vector that may separate it; the search ends
// where the pair is surely `enough` apart. `depth` asks for the depth of an overlap.
Closest closest(const Pair& pair, const double* start, double enough, bool depth) {
    Closest found;
    Simplex simplex;
    double direction[3], gap[3];
    integer ids[2];
    found.lower = -DBL_MAX;
    std::memcpy(direction, start, sizeof direction);
    for (int step = 0; step < MOST_STEPS; step++) {
        const double apart = pair.apart(direction, ids, gap);
        if (apart > found.lower) {
            found.lower = apart;
            std::memcpy(found.direction, direction, sizeof direction);
        }
        if (found.lower >= enough || simplex.has(ids)) break;
        const double known = std::sqrt(simplex.squared);
        if (simplex.count && known - found.lower <= SETTLED) break;
        Simplex more = simplex;
        more.add(gap, ids);
        more = reduced(more);
        if (more.count == 0 || !(more.squared < simplex.squared)) break;
        simplex = more;
        const double distance = std::sqrt(simplex.squared);
        if (simplex.count == 4 || distance <= SETTLED) break;
        for (int i = 0; i < 3; i++) direction[i] = simplex.nearest[i] / distance;
    }
    if (depth && simplex.count == 4 && found.lower < enough &&
        overlap_depth(pair, simplex.corner, simplex.ids, &found))
        return found;
    if (simplex.count == 0) {
        simplex.add(gap, ids);
        simplex.weight[0] = 1;
    }
    if (found.lower == -DBL_MAX) std::memcpy(found.direction, start, sizeof direction);
    set_points(pair, simplex, &found);
    return found;
}
