// Rows by control points as entries over all that a step may change: what is fixed or zero is left
// out.
#include "numerics.h"

TUBEPLANNER_API integer compressed_rows(integer rows, integer weights, integer joints,
                                        integer switches, integer free, const integer* first,
                                        const double* control, const double* switching,
                                        const double* duration, const double* elastic,
                                        const integer* variable, integer* count, integer* column,
                                        double* value) {
  integer next = 0;
  auto put = [&](integer where, double what) {
    if (what != 0.0) column[next] = where, value[next++] = what;
  };
  for (integer row = 0; row < rows; ++row) {
    const integer begin = next;
    for (integer weight = 0; weight < weights; ++weight, control += joints) {
      const integer own = variable[first[row] + weight];
      for (integer j = 0; j < joints && own >= 0; ++j) put(own * joints + j, control[j]);
    }
    const integer others = free * joints;
    for (integer k = 0; k < switches; ++k) put(others + k, *switching++);
    put(others + switches, duration[row]);
    put(others + switches + 1, -elastic[row]);
    count[row] = next - begin;
  }
  return next;
}
