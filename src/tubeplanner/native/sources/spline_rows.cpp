// Rows of linear constraints on the step of a cubic spline: how quantities at its samples change with
// its control points and switching times, by the chain rule, and which of them a step can break.
#include <cmath>

#include "numerics.h"

namespace {

constexpr integer POINTS = 4, ORDERS = 4;
constexpr int MOST_JOINTS = 9;

inline double dot(const double* a, const double* b, integer count) {
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (integer i = 0; i < count; ++i) sum += a[i] * b[i];
    return sum;
}

inline double size_of(const double* a, integer count) {
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (integer i = 0; i < count; ++i) sum += std::fabs(a[i]);
    return sum;
}

inline double largest(const double* a, integer count) {
    double most = 0;
    for (integer i = 0; i < count; ++i) {
        const double size = std::fabs(a[i]);
        most = size > most ? size : most;
    }
    return most;
}

// How much a row changes with a step within bounds.
inline double reach(const double* control, integer width, double control_size,
                    const double* switching, integer switches, const double* switching_size) {
    double found = control_size * size_of(control, width);
    for (integer g = 0; g < switches; ++g) found += std::fabs(switching[g]) * switching_size[g];
    return found;
}

// A spline at samples, and derivatives of quantities there by its own, none where nullptr. Arms of a
// usual number of joints have code of their own; else it is 0 here.
template <int JOINTS>
struct Chain {
    integer samples, any_joints, orders, switches;
    const double* weights;       // (orders, samples, 4)
    const double* by_switching;  // (switches, orders, samples, joints)
    const integer* moved;        // (samples, 2): outside, by_switching is zero; nullptr: nowhere
    const double* by[ORDERS];    // by position and derivatives, (entries, joints) each

    integer joints() const { return JOINTS ? JOINTS : any_joints; }
    const double* weight(integer o, integer sample) const {
        return weights + (o * samples + sample) * POINTS;
    }
    const double* of_switching(integer g, integer o, integer sample) const {
        return by_switching + ((g * orders + o) * samples + sample) * joints();
    }
    integer first(integer sample) const { return moved ? moved[2 * sample] : 0; }
    integer stop(integer sample) const { return moved ? moved[2 * sample + 1] : switches; }

    // How an entry of a sample changes with its control points (4, joints) and switching times.
    void row(integer sample, integer entry, double factor, double* __restrict control,
             double* __restrict switching) const {
        const integer n = joints();
        for (integer i = 0; i < POINTS * n; ++i) control[i] = 0;
        for (integer g = 0; g < switches; ++g) switching[g] = 0;
        for (integer o = 0; o < orders; ++o) {
            if (!by[o]) continue;
            const double *own = by[o] + entry * n, *share = weight(o, sample);
            for (integer r = 0; r < POINTS; ++r)
                for (integer j = 0; j < n; ++j) control[r * n + j] += factor * share[r] * own[j];
            for (integer g = first(sample); g < stop(sample); ++g)
                switching[g] += factor * dot(of_switching(g, o, sample), own, n);
        }
    }

    // What an entry's derivatives of each order (their sum of sizes) add to its reach at most.
    void factors(integer sample, double control_size, const double* switching_size,
                 double* found) const {
        for (integer o = 0; o < orders; ++o) {
            found[o] = control_size * size_of(weight(o, sample), POINTS);
            for (integer g = first(sample); by[o] && g < stop(sample); ++g)
                found[o] += switching_size[g] * largest(of_switching(g, o, sample), joints());
        }
    }
    double bound(integer entry, const double* factor) const {
        double found = 0;
        for (integer o = 0; o < orders; ++o)
            if (by[o]) found += factor[o] * size_of(by[o] + entry * joints(), joints());
        return found;
    }

    integer near(integer each, integer sides, const double* signs, const double* slack, double little,
                 double control_size, const double* switching_size, integer* index, double* control,
                 double* switching) const {
        const integer width = POINTS * joints();
        integer count = 0, number = 0;
        for (integer side = 0; side < sides; ++side)
            for (integer sample = 0; sample < samples; ++sample) {
                double factor[ORDERS];
                if (switching_size) factors(sample, control_size, switching_size, factor);
                for (integer i = 0; i < each; ++i, ++number) {
                    const integer entry = sample * each + i;
                    const double left = slack[number];
                    const bool is_chosen = left < (switching_size ? little : INFINITY);
                    if (!is_chosen && !(switching_size && left < bound(entry, factor))) continue;
                    double *points = control + count * width, *times = switching + count * switches;
                    row(sample, entry, signs[side], points, times);
                    if (is_chosen || left < reach(points, width, control_size, times, switches,
                                                  switching_size))
                        index[count++] = number;
                }
            }
        return count;
    }
};

template <int JOINTS = 0, class Use>
integer with_chain(Use use, integer samples, integer joints, integer orders, integer switches,
                   const double* weights, const double* by_switching, const integer* moved,
                   const double* const* by) {
    if constexpr (JOINTS < MOST_JOINTS)
        if (joints != JOINTS)
            return with_chain<JOINTS + 1>(use, samples, joints, orders, switches, weights,
                                          by_switching, moved, by);
    constexpr int known = JOINTS < MOST_JOINTS ? JOINTS : 0;
    return use(Chain<known>{samples, joints, orders, switches, weights, by_switching, moved,
                            {by[0], by[1], by[2], by[3]}});
}

}  // namespace

// Rows (count, 4, joints) and (count, switches) of some samples and entries.
TUBEPLANNER_API void chained_rows(integer samples, integer joints, integer orders, integer switches,
                                  const double* weights, const double* by_switching,
                                  const integer* moved, const double* by0, const double* by1,
                                  const double* by2, const double* by3, integer count,
                                  const integer* sample, const integer* entry, double* control,
                                  double* switching) {
    const double* by[ORDERS] = {by0, by1, by2, by3};
    const auto use = [=](const auto& chain) {
        for (integer k = 0; k < count; ++k)
            chain.row(sample[k], entry[k], 1, control + k * POINTS * joints,
                      switching + k * switches);
        return count;
    };
    with_chain(use, samples, joints, orders, switches, weights, by_switching, moved, by);
}

// Rows of all entries, as many per sample, and both sides, with a slack (sides, samples * each) that
// is little or less than what a step can reach, given its size, or any at all: nullptr. Returns how
// many.
TUBEPLANNER_API integer near_rows(integer samples, integer joints, integer orders, integer switches,
                                  const double* weights, const double* by_switching,
                                  const integer* moved, const double* by0, const double* by1,
                                  const double* by2, const double* by3, integer each, integer sides,
                                  const double* signs, const double* slack, double little,
                                  double control_size, const double* switching_size, integer* index,
                                  double* control, double* switching) {
    const double* by[ORDERS] = {by0, by1, by2, by3};
    const auto use = [=](const auto& chain) {
        return chain.near(each, sides, signs, slack, little, control_size, switching_size, index,
                          control, switching);
    };
    return with_chain(use, samples, joints, orders, switches, weights, by_switching, moved, by);
}

// What a step within bounds changes rows (count, width) and (count, switches) by at most.
TUBEPLANNER_API void row_reach(integer count, integer width, const double* control,
                               double control_size, integer switches, const double* switching,
                               const double* switching_size, double* found) {
    for (integer k = 0; k < count; ++k)
        found[k] = reach(control + k * width, width, control_size, switching + k * switches,
                         switches, switching_size);
}

// What a step of control points (K, joints), switching times and duration uses of rows.
TUBEPLANNER_API void used_by_step(integer count, integer joints, integer switches,
                                  const integer* first, const double* control,
                                  const double* switching, const double* duration,
                                  const double* control_change, const double* switching_change,
                                  double duration_change, double* used) {
    const integer width = POINTS * joints;
    for (integer k = 0; k < count; ++k)
        used[k] = dot(control + k * width, control_change + first[k] * joints, width) +
                  dot(switching + k * switches, switching_change, switches) +
                  duration[k] * duration_change;
}
