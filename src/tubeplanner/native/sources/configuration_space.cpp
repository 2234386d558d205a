#include "configuration_space.h"

#include <cfloat>

#include "vectors3.h"

static const integer TABLE = 4096;   // of a power of two: places by their numbers
static const integer MOST_PLACES = TABLE / 2;
static const integer FIRST_PLACES = 64;
// A search for closest points ends where they cover this fraction of an interval: nearly always the
// first direction does, and two more places cost less than further steps.
static const double ENOUGH = 0.05;

Edges::Edges(const PairRows& pairs, const Joint* joints, integer joint_count, integer n)
    : pairs_(pairs), joints_(joints), bodies_(joint_count + 1), n_(n) {
    weight_.resize(pairs.rows);
    reach_.resize(pairs.rows);
    table_.resize(TABLE);
    stamps_.resize(TABLE);
}

// Return where a place's configuration and bodies are, none of which need be placed yet.
integer Edges::slot(integer place) {
    integer at = (place * 2654435761) & (TABLE - 1);
    while (stamps_[at] == stamp_) {
        if (keys_[table_[at]] == place) return table_[at];
        at = (at + 1) & (TABLE - 1);
    }
    if (used_ == MOST_PLACES) {  // more than any usual edge has
        ++stamp_, used_ = 0;
        return slot(place);
    }
    if (used_ == slots_) {
        slots_ = slots_ ? 2 * slots_ : FIRST_PLACES;
        q_.resize(slots_ * n_);
        rotation_.resize(slots_ * bodies_ * 9);
        position_.resize(slots_ * bodies_ * 3);
        placed_.resize(slots_ * bodies_);
        keys_.resize(slots_);
    }
    const double share = double(place) / double(LAST);
    for (integer j = 0; j < n_; ++j)
        q_[used_ * n_ + j] = from_[j] + share * (to_[j] - from_[j]);
    for (integer body = 0; body < bodies_; ++body) placed_[used_ * bodies_ + body] = body == 0;
    for (int i = 0; i < 9; ++i) rotation_[used_ * bodies_ * 9 + i] = i % 4 == 0;
    for (int i = 0; i < 3; ++i) position_[used_ * bodies_ * 3 + i] = 0;
    stamps_[at] = stamp_, table_[at] = used_, keys_[used_] = place;
    return used_++;
}

// Place a body and what carries it.
void Edges::put(integer slot, integer body) {
    const integer first = slot * bodies_;
    if (placed_[first + body]) return;
    const Joint& joint = joints_[body - 1];
    const integer carrier = integer(joint.parent);
    put(slot, carrier);
    place(joint, q_.at(slot * n_), rotation_.at(9 * (first + carrier)),
          position_.at(3 * (first + carrier)), rotation_.at(9 * (first + body)),
          position_.at(3 * (first + body)));
    placed_[first + body] = true;
}

// Return a lower bound on the distance of a pair, the distance itself where that is not `enough`.
double Edges::distance(integer row, integer slot, double enough) {
    const Shapes& shapes = *pairs_.shapes;
    const integer* ids = pairs_.pairs + 2 * row;
    double center[2][3], gap[3], *direction = pairs_.directions + 3 * row;
    for (int k = 0; k < 2; ++k) {
        const integer body = shapes.body[ids[k]], at = slot * bodies_ + body;
        put(slot, body);
        turn(rotation_.at(9 * at), shapes.center + 3 * ids[k], center[k]);
        for (int i = 0; i < 3; ++i) center[k][i] += position_[3 * at + i];
    }
    minus(center[1], center[0], gap);
    const double apart = length(gap);
    const double spheres = apart - shapes.reach[ids[0]] - shapes.reach[ids[1]];
    if (spheres >= enough) return spheres;
    const Poses poses{bodies_, rotation_.at(0), position_.at(0)};
    if (!(dot(direction, direction) > 0)) {
        turn_back(poses.turned(slot, shapes.body[ids[1]]), gap, direction);
        for (int i = 0; i < 3; ++i) direction[i] = apart > 0 ? direction[i] / apart : i == 0;
    }
    const Pair pair(shapes, poses, slot, ids);
    const double grown = shapes.radius[ids[0]] + shapes.radius[ids[1]];
    const Closest found = closest(pair, direction, enough + grown);
    for (int i = 0; i < 3; ++i) direction[i] = found.direction[i];
    return found.lower - grown > spheres ? found.lower - grown : spheres;
}

// Return how far on both sides of a place a pair keeps its distance, as fractions of the edge: up
// to `enough`, and negative if it does not at the place.
double Edges::cover(integer row, integer place, double enough) {
    const integer at = slot(place);
    const double weight = weight_[row] > DBL_MIN ? weight_[row] : DBL_MIN;
    const double required = pairs_.required[row];
    const double apart = distance(row, at, required + weight * enough);
    double best = (apart - required) / weight;
    if (best >= enough) return best;
    for (integer end = 0; end < pairs_.ends; ++end) {
        const double required_there = pairs_.end_required[end * pairs_.rows + row];
        if (required_there > required || apart < required_there) continue;
        const integer body = integer(pairs_.tool[0]);
        const double* target = pairs_.end_tools + 4 * end;
        double tool[3];
        put(at, body);
        turn(rotation_.at(9 * (at * bodies_ + body)), pairs_.tool + 1, tool);
        for (int i = 0; i < 3; ++i) tool[i] += position_[3 * (at * bodies_ + body) + i] - target[i];
        const double inside = (target[3] - length(tool)) / tool_weight_;
        const double kept = (apart - required_there) / weight;
        const double both = kept < inside ? kept : inside;
        if (both > best) best = both;
    }
    return best;
}

// Return true if a pair keeps its distance between places where it does, by as much as `below` and
// `above` cover.
bool Edges::is_free_between(integer row, integer low, integer high, double below, double above) {
    const double width = double(high - low) / double(LAST);
    if (below + above >= width) return true;
    if (high - low == 1 || weight_[row] * width < pairs_.resolution) return true;
    const integer middle = (low + high) / 2;
    const double here = cover(row, middle, ENOUGH * width);
    const bool is_group = row < pairs_.groups && pairs_.members[row + 1] > pairs_.members[row];
    if (is_group && here < 0) {
        for (integer k = pairs_.members[row]; k < pairs_.members[row + 1]; ++k)
            if (!is_free_between(k, low, high, below, above)) return false;
        return true;
    }
    return here >= 0 && is_free_between(row, low, middle, below, here) &&
           is_free_between(row, middle, high, here, above);
}

// Let the group that is in a place of the order be the first one from now on.
bool Edges::fail(integer at) {
    const integer group = pairs_.order[at];
    for (; at > 0; --at) pairs_.order[at] = pairs_.order[at - 1];
    pairs_.order[0] = group;
    return false;
}

bool Edges::is_free(const double* from, const double* to) {
    ++stamp_, used_ = 0;
    from_ = from, to_ = to;
    for (integer row = 0; row < pairs_.rows; ++row) weight_[row] = 0;
    tool_weight_ = DBL_MIN;
    for (integer j = 0; j < n_; ++j) {
        const double change = std::fabs(to[j] - from[j]);
        for (integer row = 0; row < pairs_.rows; ++row)
            weight_[row] += pairs_.weights[row * n_ + j] * change;
        tool_weight_ += pairs_.tool[4 + j] * change;
    }
    for (integer k = 0; k < pairs_.groups; ++k) {
        const integer group = pairs_.order[k];
        const integer begin = pairs_.members[group], end = pairs_.members[group + 1];
        reach_[group] = cover(group, LAST, ENOUGH);
        if (reach_[group] >= 0) continue;
        if (begin == end) return fail(k);
        for (integer row = begin; row < end; ++row)
            if ((reach_[row] = cover(row, LAST, ENOUGH)) < 0) return fail(k);
    }
    for (integer k = 0; k < pairs_.groups; ++k) {
        const integer group = pairs_.order[k];
        if (reach_[group] >= 0) {
            if (!is_free_between(group, 0, LAST, 0, reach_[group])) return fail(k);
            continue;
        }
        for (integer row = pairs_.members[group]; row < pairs_.members[group + 1]; ++row)
            if (!is_free_between(row, 0, LAST, 0, reach_[row])) return fail(k);
    }
    return true;
}

// Set whether edges (count, 2, n), each from a free configuration, are free; arguments as those of
// `PairRows`, in its order.
TUBEPLANNER_API void tubeplanner_free_edges(
    const Shapes* shapes, const double* joints, integer joint_count, integer n, integer rows,
    integer groups, const integer* pairs, const integer* members, const double* required,
    const double* weights, integer ends, const double* end_tools, const double* end_required,
    const double* tool, double resolution, double* direction, integer* order, const double* edges,
    integer count, bool* free) {
    const PairRows own{shapes,    rows,         groups, pairs,      members,    required, weights,
                       ends, end_tools, end_required, tool,   resolution, direction, order};
    Edges tested(own, reinterpret_cast<const Joint*>(joints), joint_count, n);
    for (integer k = 0; k < count; ++k)
        free[k] = tested.is_free(edges + 2 * n * k, edges + 2 * n * k + n);
}
