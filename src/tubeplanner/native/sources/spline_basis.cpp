// A cubic B-spline over phases, whose knots and samples keep their shares of their phases: weights of
// its control points at samples, by the recursions of Cox and de Boor, and how it changes with the
// switching times between the phases.
#include "numerics.h"

namespace {

constexpr integer DEGREE = 3, POINTS = 4;

// A number and its derivative by one switching time.
struct Dual {
    double value = 0, by = 0;
    Dual() = default;
    Dual(double value) : value(value) {}
    Dual(double value, double by) : value(value), by(by) {}
};

inline Dual operator+(Dual a, Dual b) { return {a.value + b.value, a.by + b.by}; }
inline Dual operator-(Dual a, Dual b) { return {a.value - b.value, a.by - b.by}; }
inline Dual operator*(Dual a, Dual b) {
    return {a.value * b.value, a.by * b.value + a.value * b.by};
}
inline double reciprocal(double a) { return a > 0 ? 1 / a : 0; }
inline Dual reciprocal(Dual a) {
    const double found = reciprocal(a.value);
    return {found, -a.by * found * found};
}

// Where knot intervals begin and samples are: shares of phases.
struct Places {
    const double* switching;
    const integer* phase;
    const double* share;
};

inline void instant(const Places& at, integer i, integer, double* found) {
    const double* begin = at.switching + at.phase[i];
    *found = begin[0] + (begin[1] - begin[0]) * at.share[i];
}

// With the derivative by the switching time of a number.
inline void instant(const Places& at, integer i, integer moving, Dual* found) {
    instant(at, i, moving, &found->value);
    found->by = at.phase[i] == moving ? 1 - at.share[i] : 0;
    if (at.phase[i] + 1 == moving) found->by = at.share[i];
}

inline integer clipped(integer i, integer low, integer high) {
    return i < low ? low : i > high ? high : i;
}

// Value and derivatives of the four functions at the beginning of an interval: known[order][r].
template <class T>
T at_knot(const Places& knots, integer intervals, integer interval, integer moving,
          T known[POINTS][POINTS]) {
    T t[2 * DEGREE];
    for (integer i = 0; i < 2 * DEGREE; ++i)
        instant(knots, clipped(interval + i - 2, 0, intervals), moving, t + i);
    const T x = t[2];
    for (integer o = 0; o < POINTS; ++o)
        for (integer r = 0; r < POINTS; ++r) known[o][r] = o + r == 0 ? 1.0 : 0.0;
    for (integer k = 1; k <= DEGREE; ++k) {
        T padded[POINTS][POINTS + 1];
        for (integer r = 1; r <= k; ++r) {
            const T inverse = reciprocal(t[2 + r] - t[2 + r - k]);
            for (integer o = 0; o < k; ++o) padded[o][r] = known[o][r - 1] * inverse;
        }
        for (integer o = 0; o < k; ++o) padded[o][0] = padded[o][k + 1] = 0.0;
        for (integer r = 0; r <= k; ++r) {
            T value = 0.0;
            if (r > 0) value = (x - t[2 + r - k]) * padded[0][r];
            if (r < k) value = value + (t[3 + r] - x) * padded[0][r + 1];
            for (integer o = k; o > 0; --o)
                known[o][r] = T(double(k)) * (padded[o - 1][r] - padded[o - 1][r + 1]);
            known[0][r] = value;
        }
    }
    return x;
}

// Those at a time behind the knot, from those at the knot: a cubic's Taylor series.
template <class T>
void behind_knot(const T known[POINTS][POINTS], T behind, T weights[POINTS][POINTS]) {
    const T half = T(1. / 2) * behind, third = T(1. / 3) * behind;
    for (integer r = 0; r < POINTS; ++r) {
        const T first = known[1][r], second = known[2][r], last = known[3][r];
        weights[3][r] = last;
        weights[2][r] = second + behind * last;
        weights[1][r] = first + behind * (second + half * last);
        weights[0][r] = known[0][r] + behind * (first + half * (second + third * last));
    }
}

}  // namespace

// Knots: intervals + 1, the last one the end; weights (4, count, 4).
TUBEPLANNER_API void cubic_weights(const double* switching, integer intervals,
                                   const integer* knot_phase, const double* knot_share,
                                   integer count, const integer* phase, const double* share,
                                   const integer* interval, double* weights) {
    const Places knots = {switching, knot_phase, knot_share}, samples = {switching, phase, share};
    double known[POINTS][POINTS], here[POINTS][POINTS], begin = 0;
    integer last = -1;
    for (integer n = 0; n < count; ++n) {
        if (interval[n] != last) begin = at_knot(knots, intervals, last = interval[n], 0, known);
        double time;
        instant(samples, n, 0, &time);
        behind_knot(known, time - begin, here);
        for (integer o = 0; o < POINTS; ++o)
            for (integer r = 0; r < POINTS; ++r) weights[(o * count + n) * POINTS + r] = here[o][r];
    }
}

// Changes (switches, 4, count, joints), given as zeros; moved (count, 2): of which switching times
// they are not, by the first and the one after the last.
TUBEPLANNER_API void cubic_by_switching(const double* switching, integer intervals,
                                        const integer* knot_phase, const double* knot_share,
                                        integer count, const integer* phase, const double* share,
                                        const integer* interval, integer joints,
                                        const double* control, integer switches, double* changes,
                                        integer* moved) {
    const Places knots = {switching, knot_phase, knot_share}, samples = {switching, phase, share};
    for (integer n = 0; n < count; ++n) {
        integer low = knot_phase[clipped(interval[n] - 2, 0, intervals)];
        integer high = knot_phase[clipped(interval[n] + 3, 0, intervals)];
        if (phase[n] < low) low = phase[n];
        if (phase[n] > high) high = phase[n];
        moved[2 * n] = clipped(low - 1, 0, switches);
        moved[2 * n + 1] = clipped(high + 1, 0, switches);
    }
    for (integer g = 0; g < switches; ++g) {
        Dual known[POINTS][POINTS], here[POINTS][POINTS], begin;
        integer last = -1;
        for (integer n = 0; n < count; ++n) {
            if (g < moved[2 * n] || g >= moved[2 * n + 1]) continue;
            if (interval[n] != last)
                begin = at_knot(knots, intervals, last = interval[n], g + 1, known);
            Dual time;
            instant(samples, n, g + 1, &time);
            behind_knot(known, time - begin, here);
            const double* near = control + interval[n] * joints;
            for (integer o = 0; o < POINTS; ++o) {
                double* change = changes + ((g * POINTS + o) * count + n) * joints;
                for (integer r = 0; r < POINTS; ++r)
                    for (integer j = 0; j < joints; ++j)
                        change[j] += here[o][r].by * near[r * joints + j];
            }
        }
    }
}

// Values (orders, count, joints) of weights (orders, count, 4) on the control points from first on.
TUBEPLANNER_API void cubic_values(integer orders, integer count, integer joints,
                                  const double* weights, const integer* first,
                                  const double* control, double* values) {
    for (integer o = 0; o < orders; ++o)
        for (integer n = 0; n < count; ++n, weights += POINTS, values += joints) {
            const double *w = weights, *a = control + first[n] * joints, *b = a + joints;
            const double *c = b + joints, *d = c + joints;
            for (integer j = 0; j < joints; ++j)
                values[j] = w[0] * a[j] + w[1] * b[j] + w[2] * c[j] + w[3] * d[j];
        }
}
