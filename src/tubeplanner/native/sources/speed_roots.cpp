// Up to which speed polynomials stay within bounds: the first crossing of zero of cubics.
#include <cmath>

#include "numerics.h"

namespace {

constexpr int DEGREE = 3, MAX_STEPS = 100;
constexpr double ROUNDING = 2e-15;  // of the sum of the terms' magnitudes

struct Cubic {
    double c[DEGREE + 1];

    double value(double s) const { return ((c[3] * s + c[2]) * s + c[1]) * s + c[0]; }
    double slope(double s) const { return (3 * c[3] * s + 2 * c[2]) * s + c[1]; }
    double size(double s) const {
        return ((std::fabs(c[3]) * s + std::fabs(c[2])) * s + std::fabs(c[1])) * s +
               std::fabs(c[0]);
    }
};

// The root between two places that a cubic rises between, by Newton's steps, by halves where these
// lead out.
double root_between(const Cubic& f, double low, double high) {
    double s = high;
    for (int step = 0; step < MAX_STEPS; ++step) {
        const double value = f.value(s);
        if (std::fabs(value) <= ROUNDING * f.size(s)) break;
        (value > 0 ? high : low) = s;
        const double next = s - value / f.slope(s);
        s = next > low && next < high ? next : (low + high) / 2;
    }
    return s;
}

// Places where a cubic turns, in order, of those above zero; how many.
int turns(const Cubic& f, double* found) {
    const double a = 3 * f.c[3], b = 2 * f.c[2], c = f.c[1], square = b * b - 4 * a * c;
    if (square < 0) return 0;
    const double half = -(b + (b < 0 ? -1 : 1) * std::sqrt(square)) / 2;
    const double places[2] = {half / a, c / half};
    int count = 0;
    for (const double place : places)
        if (place > 0 && place < INFINITY) found[count++] = place;
    if (count == 2 && found[0] > found[1]) {
        const double first = found[1];
        found[1] = found[0], found[0] = first;
    }
    return count;
}

// Up to which s >= 0 a cubic stays at or below zero: 0 where it is above at once.
double first_crossing(Cubic f) {
    int lowest = 0, degree = DEGREE;
    while (lowest < DEGREE && f.c[lowest] == 0) ++lowest;
    if (f.c[lowest] > 0) return 0;
    while (degree > 0 && f.c[degree] == 0) --degree;
    // The largest size of roots, within a factor of two (Fujiwara 1916); terms are of one size then.
    double scale = 0, most = 0, power = 1;
    for (int k = 0; k < degree; ++k)
        scale = std::fmax(scale, std::pow(std::fabs(f.c[k] / f.c[degree]), 1. / (degree - k)));
    if (scale == 0) return INFINITY;
    for (int k = 0; k <= DEGREE; ++k, power *= scale)
        most = std::fmax(most, std::fabs(f.c[k] *= power));
    for (double& c : f.c) c /= most;
    double low = 0, places[2];
    const int count = turns(f, places);
    for (int k = 0; k < count; low = places[k++])
        if (f.value(places[k]) > 0) return scale * root_between(f, low, places[k]);
    if (f.c[degree] <= 0) return INFINITY;
    return scale * root_between(f, low, std::fmax(2.5, low));
}

// Up to which s >= 0 use * s^power is at most what is available.
double single_root(int power, double available, double use) {
    if (available < 0 || (available == 0 && use > 0)) return 0;
    if (!(use > 0)) return INFINITY;
    const double found = available / use;
    return power == 1 ? found : power == 2 ? std::sqrt(found) : std::cbrt(found);
}

}  // namespace

// Up to which speeds sign * (sum of term k * speed^k) <= 1 for all signs, by terms that may be
// nullptr; a single power above 0 has a closed form.
TUBEPLANNER_API void largest_speeds(integer count, const double* held, const double* first,
                                    const double* second, const double* third, integer sides,
                                    const double* signs, double* found) {
    const double* terms[DEGREE + 1] = {held, first, second, third};
    int single = 0, powers = 0;
    for (int k = 1; k <= DEGREE; ++k)
        if (terms[k]) single = k, ++powers;
    for (integer i = 0; i < count; ++i) {
        found[i] = INFINITY;
        for (integer side = 0; side < sides; ++side) {
            Cubic f;
            for (int k = 0; k <= DEGREE; ++k) f.c[k] = terms[k] ? signs[side] * terms[k][i] : 0;
            f.c[0] -= 1;
            const double own = powers == 1 ? single_root(single, -f.c[0], f.c[single])
                                           : first_crossing(f);
            found[i] = own < found[i] ? own : found[i];
        }
    }
}
