// Symmetric positive definite matrices that are banded but for a few last rows: an arrow.
#pragma once

#include "array.h"

class ArrowFactor {
 public:
  // `band` rows are banded, row i reaching to i + `width`; `others` follow that reach everywhere.
  void shape(integer band, integer width, integer others);
  void zero();
  // Adds a value to the entry of two variables, the second not before the first.
  void add(integer first, integer second, double value) { *entry(first, second) += value; }
  // Adds sum_k weight[k] v_k v_k^T, v_k being `count` long from variable `first` on, 4 at a time.
  void add_squares(integer first, integer count, const double* const* vectors,
                   const double* weights);
  // Adds a multiple of a vector to the entries of banded variables from `first` on and another.
  void add_cross(integer other, integer first, integer count, const double* vector, double factor) {
    double* to = arrow_.at(other * band_ + first);
    for (integer i = 0; i < count; ++i) to[i] += factor * vector[i];
  }
  void factorize();
  // Replaces a right-hand side by the solution.
  void solve(double* x) const;

 private:
  double* entry(integer first, integer second);
  const double* column(integer j) const { return lower_.at(j * stride_); }
  void factorize_band();
  void factorize_arrow();

  integer band_ = 0, width_ = 0, stride_ = 0, others_ = 0;
  // Column j of the band from its diagonal on; the arrow, row by row over the band; its corner.
  Array<double> lower_, arrow_, corner_;
};
