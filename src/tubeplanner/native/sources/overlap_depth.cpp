// The depth of an overlap: a polytope of differences of two hulls' points, around the origin, grows
// until its side nearest to the origin is one of all differences (G. van den Bergen, "Proximity
// queries and penetration depth computation on 3D game objects", 2001). The polytope bounds the
// depth from below, the reach of all points along any direction bounds it from above.
#include <cfloat>
#include <cstring>

#include "convex_pairs.h"
#include "vectors3.h"

static const int MOST_CORNERS = 192;
static const int MOST_FACES = 2 * MOST_CORNERS;
static const double SETTLED = 1e-10;  // bounds this near each other are the depth [m]
static const double VISIBLE = 1e-12;  // a corner this far beyond a face is not on it [m]
static const double FLAT = 1e-20;     // the squared sine of a corner of a triangle without area

namespace {

struct Face {
    int at[3];  // its corners, counterclockwise from outside
    double normal[3];
    double offset;  // no point of it is nearer to the origin [m]
};

struct Polytope {
    int corners = 0, faces = 0, edges = 0;
    double corner[MOST_CORNERS][3];
    integer ids[MOST_CORNERS][2];
    Face face[MOST_FACES];
    int edge[MOST_FACES][2];  // of the hole that a new corner fills

    bool has(const integer* id) const {
        for (int k = 0; k < corners; k++)
            if (ids[k][0] == id[0] && ids[k][1] == id[1]) return true;
        return false;
    }

    // Add a face; return false if it has no area.
    bool add_face(int a, int b, int c) {
        if (faces == MOST_FACES) return false;
        Face& added = face[faces];
        double one[3], other[3];
        minus(corner[b], corner[a], one);
        minus(corner[c], corner[a], other);
        cross(one, other, added.normal);
        const double area = dot(added.normal, added.normal);
        if (!(area > FLAT * dot(one, one) * dot(other, other))) return false;
        added.offset = DBL_MAX;
        const int at[3] = {a, b, c};
        for (int i = 0; i < 3; i++) added.normal[i] /= std::sqrt(area);
        for (int k = 0; k < 3; k++) {
            const double offset = dot(added.normal, corner[at[k]]);
            added.offset = offset < added.offset ? offset : added.offset;
            added.at[k] = at[k];
        }
        faces++;
        return true;
    }

    // Set the four faces of the first four corners.
    bool close() {
        static const int sides[4][4] = {{0, 1, 2, 3}, {0, 1, 3, 2}, {0, 2, 3, 1}, {1, 2, 3, 0}};
        for (const int* side : sides) {
            if (!add_face(side[0], side[1], side[2])) return false;
            double inward[3];
            minus(corner[side[3]], corner[side[0]], inward);
            if (dot(face[faces - 1].normal, inward) < 0) continue;
            faces--;
            if (!add_face(side[0], side[2], side[1])) return false;
        }
        return true;
    }

    const Face& nearest() const {
        int best = 0;
        for (int f = 1; f < faces; f++)
            if (face[f].offset < face[best].offset) best = f;
        return face[best];
    }

    // Add an edge of the hole, or remove it if it is there the other way.
    void toggle(int a, int b) {
        for (int e = 0; e < edges; e++) {
            if (edge[e][0] != b || edge[e][1] != a) continue;
            std::memcpy(edge[e], edge[--edges], sizeof edge[e]);
            return;
        }
        edge[edges][0] = a, edge[edges++][1] = b;
    }

    // Return whether the hole has one rim, which goes once round.
    bool has_one_rim() const {
        int steps = 0, at = edge[0][0];
        do {
            int next = -1;
            for (int e = 0; e < edges; e++) {
                if (edge[e][0] != at) continue;
                if (next >= 0) return false;
                next = edge[e][1];
            }
            if (next < 0) return false;
            at = next, steps++;
        } while (at != edge[0][0] && steps <= edges);
        return steps == edges;
    }

    // Add a corner outside, which replaces the faces that it sees; return false if that fails.
    bool grow(const double* gap, const integer* id) {
        if (corners == MOST_CORNERS) return false;
        std::memcpy(corner[corners], gap, sizeof corner[0]);
        std::memcpy(ids[corners], id, sizeof ids[0]);
        edges = 0;
        for (int f = faces - 1; f >= 0; f--) {
            const int* at = face[f].at;
            if (dot(face[f].normal, gap) <= face[f].offset + VISIBLE) continue;
            if (edges > MOST_FACES - 3) return false;
            for (int k = 0; k < 3; k++) toggle(at[k], at[(k + 1) % 3]);
            face[f] = face[--faces];
        }
        if (edges < 3 || !has_one_rim()) return false;
        for (int e = 0; e < edges; e++)
            if (!add_face(edge[e][0], edge[e][1], corners)) return false;
        corners++;
        return true;
    }

    // Set the weights of a face's corners at the foot of the origin on a plane; return the least.
    double weigh(const Face& at, const double* foot, double* weight) const {
        double away[3][3], normal[3], sum = 0, least = DBL_MAX;
        for (int k = 0; k < 3; k++) minus(corner[at.at[k]], foot, away[k]);
        for (int k = 0; k < 3; k++) {
            cross(away[(k + 1) % 3], away[(k + 2) % 3], normal);
            sum += weight[k] = dot(normal, at.normal);
        }
        for (int k = 0; k < 3; k++) {
            weight[k] /= sum;
            least = weight[k] < least ? weight[k] : least;
        }
        return least;
    }

    // Set the points of both hulls at the foot of the origin on a face, or on one beside it that
    // lies in the same plane.
    void set_points(const Pair& pair, const Face& nearest, Closest* found) const {
        double foot[3], best = -DBL_MAX, weight[3], chosen[3] = {1, 0, 0};
        const Face* chosen_face = &nearest;
        for (int i = 0; i < 3; i++) foot[i] = nearest.offset * nearest.normal[i];
        for (int f = 0; f < faces; f++) {
            const bool in_plane = face[f].offset <= nearest.offset + SETTLED &&
                                  dot(face[f].normal, nearest.normal) >= 1 - VISIBLE;
            if (!in_plane) continue;
            const double least = weigh(face[f], foot, weight);
            if (!(least > best)) continue;
            best = least, chosen_face = face + f;
            std::memcpy(chosen, weight, sizeof weight);
        }
        double first[3], second[3];
        for (int i = 0; i < 3; i++) found->first[i] = found->second[i] = 0;
        for (int k = 0; k < 3; k++) {
            pair.point(ids[chosen_face->at[k]], first, second);
            for (int i = 0; i < 3; i++) {
                found->first[i] += chosen[k] * first[i];
                found->second[i] += chosen[k] * second[i];
            }
        }
    }
};

}  // namespace

// Set the closest points of a pair that overlaps, from four differences around the origin; return
// false, and leave them as they are, if rounding or too many corners are in the way.
bool overlap_depth(const Pair& pair, const double corner[4][3], const integer ids[4][2],
                   Closest* found) {
    Polytope polytope;
    std::memcpy(polytope.corner, corner, 4 * sizeof polytope.corner[0]);
    std::memcpy(polytope.ids, ids, 4 * sizeof polytope.ids[0]);
    polytope.corners = 4;
    if (!polytope.close()) return false;
    while (true) {
        const Face nearest = polytope.nearest();
        if (nearest.offset < -VISIBLE) return false;
        double gap[3], direction[3];
        integer id[2];
        for (int i = 0; i < 3; i++) direction[i] = -nearest.normal[i];
        const double apart = pair.apart(direction, id, gap);
        if (-apart - nearest.offset <= SETTLED) {
            found->lower = apart, found->upper = -nearest.offset;
            std::memcpy(found->direction, direction, sizeof direction);
            polytope.set_points(pair, nearest, found);
            return true;
        }
        if (polytope.has(id) || !polytope.grow(gap, id)) return false;
    }
}
