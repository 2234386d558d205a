// Cholesky factors of banded matrices with an arrow, four columns at a time.
#include "arrow_factor.h"

#include <cmath>

namespace {

// A pivot that rounding has made as small as this is that of a variable which nothing determines.
constexpr double kNoPivot = 1e-30, kHuge = 1e100;
constexpr integer kPanel = 4;

double root(double pivot) { return pivot > kNoPivot ? std::sqrt(pivot) : kHuge; }

// to[0..count) -= sum of four multiples.
inline void subtract4(double* __restrict to, integer count, const double* __restrict a,
                      const double* __restrict b, const double* __restrict c,
                      const double* __restrict d, const double* factor) {
  const double fa = factor[0], fb = factor[1], fc = factor[2], fd = factor[3];
  for (integer i = 0; i < count; ++i) to[i] -= (fa * a[i] + fb * b[i]) + (fc * c[i] + fd * d[i]);
}

inline void subtract(double* __restrict to, integer count, const double* __restrict a,
                     double factor) {
  for (integer i = 0; i < count; ++i) to[i] -= factor * a[i];
}

inline double dot(const double* a, const double* b, integer count) {
  double sum = 0.0;
#pragma omp simd reduction(+ : sum)
  for (integer i = 0; i < count; ++i) sum += a[i] * b[i];
  return sum;
}

integer least(integer a, integer b) { return a < b ? a : b; }

}  // namespace

void ArrowFactor::shape(integer band, integer width, integer others) {
  band_ = band, width_ = width, others_ = others;
  stride_ = width + 1 + kPanel;  // columns of a panel are read a little beyond their ends: zeros
  lower_.resize(band * stride_);
  arrow_.resize(others * band);
  corner_.resize(others * others);
}

void ArrowFactor::zero() {
  lower_.clear();
  arrow_.clear();
  corner_.clear();
}

double* ArrowFactor::entry(integer first, integer second) {
  if (second < band_) return lower_.at(first * stride_ + second - first);
  if (first < band_) return arrow_.at((second - band_) * band_ + first);
  return corner_.at((second - band_) * others_ + first - band_);
}

void ArrowFactor::add_squares(integer first, integer count, const double* const* vectors,
                              const double* weights) {
  for (integer i = 0; i < count; ++i) {
    double factor[kPanel];
    for (integer k = 0; k < kPanel; ++k) factor[k] = -weights[k] * vectors[k][i];
    subtract4(lower_.at((first + i) * stride_), count - i, vectors[0] + i, vectors[1] + i,
              vectors[2] + i, vectors[3] + i, factor);
  }
}

void ArrowFactor::factorize() {
  factorize_band();
  factorize_arrow();
}

void ArrowFactor::factorize_band() {
  for (integer begin = 0; begin < band_; begin += kPanel) {
    const integer end = least(begin + kPanel, band_);
    for (integer j = begin; j < end; ++j) {  // the panel itself; its pivots are kept inverted
      double* own = lower_.at(j * stride_);
      const double scale = 1.0 / root(own[0]);
      own[0] = scale;
      for (integer i = 1; i <= width_; ++i) own[i] *= scale;
      for (integer k = j + 1; k < end; ++k) {
        const integer off = k - j;
        if (off <= width_) {
          subtract(lower_.at(k * stride_), width_ + 1 - off, own + off, own[off]);
        }
      }
    }
    if (end - begin < kPanel) break;
    const integer last = least(begin + kPanel - 1 + width_, band_ - 1);
    for (integer k = end; k <= last; ++k) {  // what it takes from the columns behind
      const double* from[kPanel];
      double factor[kPanel];
      for (integer p = 0; p < kPanel; ++p) {
        from[p] = column(begin + p) + (k - begin - p);
        factor[p] = from[p][0];
      }
      const integer count = begin + kPanel - 1 + width_ - k + 1;
      subtract4(lower_.at(k * stride_), count, from[0], from[1], from[2], from[3], factor);
    }
  }
}

void ArrowFactor::factorize_arrow() {
  for (integer p = 0; p < others_; ++p) {
    double* own = arrow_.at(p * band_);
    integer first = 0;
    while (first < band_ && own[first] == 0.0) ++first;
    for (integer j = first; j < band_; ++j) {
      own[j] *= column(j)[0];
      subtract(own + j + 1, least(width_, band_ - 1 - j), column(j) + 1, own[j]);
    }
    for (integer q = 0; q <= p; ++q) {
      corner_[p * others_ + q] -= dot(own + first, arrow_.at(q * band_ + first), band_ - first);
    }
  }
  for (integer p = 0; p < others_; ++p) {
    double* own = corner_.at(p * others_);
    for (integer q = 0; q < p; ++q) {
      const double* before = corner_.at(q * others_);
      own[q] = (own[q] - dot(own, before, q)) / before[q];
    }
    own[p] = root(own[p] - dot(own, own, p));
  }
}

void ArrowFactor::solve(double* x) const {
  double* rest = x + band_;
  for (integer j = 0; j < band_; ++j) {
    x[j] *= column(j)[0];
    subtract(x + j + 1, least(width_, band_ - 1 - j), column(j) + 1, x[j]);
  }
  for (integer p = 0; p < others_; ++p) {
    const double* own = corner_.at(p * others_);
    rest[p] = (rest[p] - dot(arrow_.at(p * band_), x, band_) - dot(own, rest, p)) / own[p];
  }
  for (integer p = others_ - 1; p >= 0; --p) {
    rest[p] /= corner_[p * others_ + p];
    for (integer q = 0; q < p; ++q) rest[q] -= corner_[p * others_ + q] * rest[p];
    subtract(x, band_, arrow_.at(p * band_), rest[p]);
  }
  for (integer j = band_ - 1; j >= 0; --j) {
    x[j] = (x[j] - dot(column(j) + 1, x + j + 1, least(width_, band_ - 1 - j))) * column(j)[0];
  }
}
