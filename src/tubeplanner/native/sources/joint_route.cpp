// Two trees of free edges in the space of an arm's joints, that grow until they meet.
//
// Counterpart of `RouteSearch` in tubeplanner/first_guess/joint_routes.py, which explains it.
#include "configuration_space.h"

// What is told from call to call: nodes of both trees, whose turn it is, the random numbers' state,
// edges tested, and where both trees have met.
enum State { COUNT, TURN = 2, RANDOM, EDGES, MET };

struct Trees {
    Edges& edges;
    integer n, capacity;
    const double *low, *high, *speed;
    double range, domain;
    double* q;        // (2, capacity, n)
    double* reach;    // (2, capacity): how far samples may be from a node
    integer* parent;  // (2, capacity)
    integer* state;
    double* sample;   // (n,)

    double* node(integer tree, integer k) { return q + (tree * capacity + k) * n; }

    double fraction() {
        uint64_t z = uint64_t(state[RANDOM]) + 0x9E3779B97F4A7C15u;
        state[RANDOM] = integer(z);
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
        return double((z ^ (z >> 31)) >> 11) * 0x1p-53;
    }

    integer nearest(integer tree, const double* to, double* distance) {
        integer best = 0;
        double least = INFINITY;
        for (integer k = 0; k < state[COUNT + tree]; ++k) {
            double squared = 0;
            for (integer j = 0; j < n; ++j) {
                const double away = (node(tree, k)[j] - to[j]) / speed[j];
                squared += away * away;
            }
            if (squared < least) least = squared, best = k;
        }
        *distance = std::sqrt(least);
        return best;
    }

    // Return a new node on the way from a node to a configuration, -1 if the edge is not free.
    integer step(integer tree, integer from, const double* to, double share) {
        const double* own = node(tree, from);
        double* next = node(tree, state[COUNT + tree]);
        for (integer j = 0; j < n; ++j)
            next[j] = share < 1 ? own[j] + share * (to[j] - own[j]) : to[j];
        ++state[EDGES];
        if (!edges.is_free(own, next)) return -1;
        reach[tree * capacity + state[COUNT + tree]] = INFINITY;
        parent[tree * capacity + state[COUNT + tree]] = from;
        return state[COUNT + tree]++;
    }

    integer grow(integer tree, integer most_refused) {
        double distance = 0;
        integer from = 0;
        for (integer k = 0; k < most_refused; ++k) {
            for (integer j = 0; j < n; ++j) sample[j] = low[j] + fraction() * (high[j] - low[j]);
            from = nearest(tree, sample, &distance);
            if (distance <= reach[tree * capacity + from]) break;
        }
        const integer next = step(tree, from, sample, distance > range ? range / distance : 1.0);
        if (next < 0) reach[tree * capacity + from] = domain;
        return next;
    }

    integer connect(integer tree, const double* to) {
        double distance;
        integer from = nearest(tree, to, &distance);
        while (distance > 0) {
            from = step(tree, from, to, distance > range ? range / distance : 1.0);
            if (from < 0) return -1;
            distance -= range;
        }
        return from;
    }
};

// Let both trees grow until they meet or `last` edges were tested; the first arguments are those of
// `tubeplanner_free_edges`. Memory holds a configuration, (n,).
TUBEPLANNER_API void tubeplanner_grow_trees(
    const Shapes* shapes, const double* joints, integer joint_count, integer n, integer rows,
    integer groups, const integer* pairs, const integer* members, const double* required,
    const double* weights, integer ends, const double* end_tools, const double* end_required,
    const double* tool, double resolution, double* direction, integer* order, const double* low,
    const double* high, const double* speed, double range, double domain, integer most_refused,
    integer last, integer capacity, double* tree_q, double* reach, integer* parent, integer* state,
    double* memory) {
    const PairRows own{shapes,    rows,         groups, pairs,      members,   required, weights,
                       ends, end_tools, end_required, tool,   resolution, direction, order};
    Edges edges(own, reinterpret_cast<const Joint*>(joints), joint_count, n);
    Trees trees{edges, n,      capacity, low,    high,  speed, range,
                domain, tree_q, reach,    parent, state, memory};
    while (state[EDGES] < last) {
        const integer tree = state[TURN];
        state[TURN] = 1 - tree;
        const integer node = trees.grow(tree, most_refused);
        if (node < 0) continue;
        const integer met = trees.connect(1 - tree, trees.node(tree, node));
        if (met < 0) continue;
        state[MET + tree] = node, state[MET + 1 - tree] = met;
        return;
    }
}
