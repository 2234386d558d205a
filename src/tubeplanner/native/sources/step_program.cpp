// The program of one step: an interior-point method (Mehrotra, "On the implementation of a
// primal-dual interior point method", 1992) whose rows may join while it runs.
//
// Variables stay between their bounds; rows get there. Those that are given late begin with more
// slack than they have: one that is all but broken would hold up all others.
#include "step_program.h"

#include <cmath>
#include <initializer_list>
#include <new>

namespace {

// Rows with at most one entry in so many are kept as entries.
constexpr integer kSparse = 3;
// How near to a bound variables begin, as a share of what lies between both; bounds that leave
// less than the other are moved apart by it.
constexpr double kInside = 0.05, kLeastWidth = 1e-9;
// Rows that join later do so where the sum of products was last above this.
constexpr double kCentral = 0.05;
constexpr double kFirstSlack = 0.1, kJoiningSlack = 0.3, kFirstProduct = 0.3;
// Steps end this share before a slack or a multiplier is used up.
constexpr double kShare = 0.99;
constexpr double kRegular = 1e-11, kHopeless = 1e100;
constexpr integer kTogether = 4;
constexpr double kShareOfCost = 0.1;  // of what gradients might still gain
// Where all that counts is at its limit, rounding keeps gradients from getting better: after so many
// steps that got no nearer, the nearest will do, so many times the tolerance off, or this much.
constexpr integer kPatience = 15;
constexpr double kAlmost = 500.0, kAlmostMost = 0.05;

double larger(double a, double b) { return a > b ? a : b; }
double smaller(double a, double b) { return a < b ? a : b; }

}  // namespace

StepProgram::StepProgram(integer size, integer band, const double* first, const double* linear,
                         const double* lower, const double* upper)
    : size_(size), band_(band) {
  for (Array<double>* own : {&first_, &linear_, &lower_, &upper_, &x_, &dx_, &gradient_}) own->resize(size);
  for (Array<double>* own : {&s_, &z_, &ds_, &dz_, &wanted_}) own->resize(2 * size);
  for (integer i = 0; i < size; ++i) {
    first_[i] = first[i], linear_[i] = linear[i], lower_[i] = lower[i], upper_[i] = upper[i];
    if (upper_[i] - lower_[i] < kLeastWidth) lower_[i] -= kLeastWidth, upper_[i] += kLeastWidth;
  }
}

void StepProgram::add_quadratic(integer count, const integer* row, const integer* column,
                                const double* value) {
  for (integer k = 0; k < count; ++k) {
    if (row[k] > column[k] || value[k] == 0.0) continue;
    quadratic_.push({column[k], value[k]});
    quadratic_row_.push(row[k]);
    if (column[k] < band_ && column[k] - row[k] > width_) width_ = column[k] - row[k];
  }
}

void StepProgram::add_rows(integer count, const integer* entries, const integer* column,
                           const double* value, const double* slack) {
  const integer known = rows_.size();
  go_back();
  rows_.resize(known + count);
  for (Array<double>* own : {&s_, &z_, &ds_, &dz_, &wanted_}) {
    own->resize(2 * size_ + known + count);
  }
  for (integer r = 0; r < count; column += entries[r], value += entries[r], ++r) {
    Row& row = rows_[known + r];
    integer first = band_, last = -1, banded = 0;
    for (integer k = 0; k < entries[r]; ++k) {
      if (column[k] >= band_) continue;
      ++banded;
      if (column[k] < first) first = column[k];
      if (column[k] > last) last = column[k];
    }
    row.first = banded ? first : 0, row.width = banded ? last - first + 1 : 0;
    if (row.width - 1 > width_) width_ = row.width - 1;
    row.is_sparse = banded * kSparse <= row.width;
    row.dense = dense_.size(), row.sparse = entries_.size();
    if (!row.is_sparse) dense_.resize(row.dense + row.width);
    for (integer k = 0; k < entries[r]; ++k) {
      if (column[k] >= band_) continue;
      if (row.is_sparse) put(row.sparse, {column[k], value[k]});
      else dense_[row.dense + column[k] - first] += value[k];
    }
    row.others = entries_.size();
    for (integer k = 0; k < entries[r]; ++k) {
      if (column[k] >= band_) put(row.others, {column[k], value[k]});
    }
    row.end = entries_.size();
    row.slack = slack[r];
    if (has_started_) start_row(known + r, kJoiningSlack);
  }
  // In the order of what they begin with and of how much they hold: added up together.
  Array<integer> begin;
  begin.resize(band_ + 2);
  order_.resize(rows_.size());
  for (integer r = 0; r < rows_.size(); ++r) ++begin[rows_[r].first + 1];
  for (integer j = 0; j <= band_; ++j) begin[j + 1] += begin[j];
  for (integer r = 0; r < rows_.size(); ++r) order_[begin[rows_[r].first]++] = r;
}

// Where all but what binds is used up already, nothing new finds its place.
void StepProgram::go_back() {
  if (!has_started_ || kept_.is_empty()) return;
  const integer known = kept_.give(x_, s_, z_, &mean_);
  for (integer row = known - 2 * size_; row < rows_.size(); ++row) start_row(row, kJoiningSlack);
}

void StepProgram::Place::take(const Array<double>& x, const Array<double>& s,
                              const Array<double>& z, double mean) {
  x_.copy(x), s_.copy(s), z_.copy(z);
  mean_ = mean;
}

integer StepProgram::Place::give(Array<double>& x, Array<double>& s, Array<double>& z,
                                 double* mean) const {
  x.begin_with(x_), s.begin_with(s_), z.begin_with(z_);
  *mean = mean_;
  return s_.size();
}

// Control points that move as one are one variable.
void StepProgram::put(integer first, const Entry& entry) {
  for (integer k = first; k < entries_.size(); ++k) {
    if (entries_[k].variable != entry.variable) continue;
    entries_[k].value += entry.value;
    return;
  }
  entries_.push(entry);
}

void StepProgram::set_slack(const double* slack) {
  for (integer r = 0; r < rows_.size(); ++r) rows_[r].slack = slack[r];
  has_started_ = false;
}

double StepProgram::used(const Row& row, const double* x) const {
  double sum = 0.0;
  if (!row.is_sparse) {
    const double *a = dense_.at(row.dense), *from = x + row.first;
#pragma omp simd reduction(+ : sum)
    for (integer i = 0; i < row.width; ++i) sum += a[i] * from[i];
  }
  for (integer k = row.sparse; k < row.end; ++k) {
    sum += entries_[k].value * x[entries_[k].variable];
  }
  return sum;
}

void StepProgram::collect(const Row& row, double factor, double* to) const {
  if (!row.is_sparse) {
    const double* __restrict a = dense_.at(row.dense);
    double* __restrict own = to + row.first;
    for (integer i = 0; i < row.width; ++i) own[i] += factor * a[i];
  }
  for (integer k = row.sparse; k < row.end; ++k) {
    to[entries_[k].variable] += factor * entries_[k].value;
  }
}

void StepProgram::start() {
  has_started_ = true;
  kept_.forget();
  ds_.clear(), dz_.clear();  // of a step that failed
  mean_ = kFirstProduct;
  for (integer i = 0; i < size_; ++i) {
    const double margin = smaller(kInside * (upper_[i] - lower_[i]), kInside);
    x_[i] = larger(smaller(first_[i], upper_[i] - margin), lower_[i] + margin);
    const bool ends = !std::isinf(upper_[i]);
    s_[i] = x_[i] - lower_[i], s_[size_ + i] = ends ? upper_[i] - x_[i] : 1.0;
    z_[i] = mean_ / s_[i], z_[size_ + i] = ends ? mean_ / s_[size_ + i] : 0.0;
  }
  for (integer r = 0; r < rows_.size(); ++r) start_row(r, kFirstSlack);
}

void StepProgram::start_row(integer row, double least) {
  const integer pair = 2 * size_ + row;
  s_[pair] = larger(rows_[row].slack - used(rows_[row], x_.at(0)), least);
  z_[pair] = mean_ / s_[pair];
}

// The gradient of the Lagrangian, by how much it and rows are off, and the mean product.
void StepProgram::evaluate() {
  const double* z = z_.at(2 * size_);
  for (integer i = 0; i < size_; ++i) gradient_[i] = linear_[i] - z_[i] + z_[size_ + i];
  for (integer k = 0; k < quadratic_.size(); ++k) {
    const integer row = quadratic_row_[k], column = quadratic_[k].variable;
    gradient_[row] += quadratic_[k].value * x_[column];
    if (row != column) gradient_[column] += quadratic_[k].value * x_[row];
  }
  infeasible_ = 0.0;
  for (integer r = 0; r < rows_.size(); ++r) {
    Row& row = rows_[r];
    collect(row, z[r], gradient_.at(0));
    infeasible_ = larger(infeasible_, std::fabs(row.residual));
  }
  double less = 0.0;  // by what the cost might be less
  for (integer i = 0; i < size_; ++i) {
    less += smaller(upper_[i] - lower_[i], 1.0) * std::fabs(gradient_[i]);
  }
  infeasible_ = larger(infeasible_, kShareOfCost * less);
  mean_ = product(0.0, 0.0) / s_.size();
}

// The sum of all products after steps of some lengths.
double StepProgram::product(double primal, double dual) const {
  const double *s = s_.at(0), *z = z_.at(0), *ds = ds_.at(0), *dz = dz_.at(0);
  double sum = 0.0;
#pragma omp simd reduction(+ : sum)
  for (integer k = 0; k < s_.size(); ++k) sum += (s[k] + primal * ds[k]) * (z[k] + dual * dz[k]);
  return sum;
}

void StepProgram::assemble() {
  factor_.zero();
  for (integer k = 0; k < quadratic_.size(); ++k) {
    factor_.add(quadratic_row_[k], quadratic_[k].variable, quadratic_[k].value);
  }
  for (integer i = 0; i < size_; ++i) {
    factor_.add(i, i, z_[i] / s_[i] + z_[size_ + i] / s_[size_ + i] + kRegular);
  }
  integer begin = 0;
  for (integer k = 0; k < rows_.size(); ++k) {
    Row& row = rows_[order_[k]];
    row.weight = z_[2 * size_ + order_[k]] / s_[2 * size_ + order_[k]];
    add_others(row);
    if (k + 1 == rows_.size() || rows_[order_[k + 1]].first != row.first) {
      add_dense(begin, k + 1);
      begin = k + 1;
    }
  }
  factor_.factorize();
}

// The squares of rows that begin with one variable, some of one width together.
void StepProgram::add_dense(integer begin, integer end) {
  const double* vectors[kTogether];
  double weights[kTogether];
  integer found = 0, width = 0;
  const integer first = rows_[order_[begin]].first;
  auto flush = [&] {
    if (found == 0) return;
    for (; found < kTogether; ++found) vectors[found] = vectors[0], weights[found] = 0.0;
    factor_.add_squares(first, width, vectors, weights);
    found = 0;
  };
  for (integer k = begin; k < end; ++k) {
    const Row& row = rows_[order_[k]];
    if (row.is_sparse) continue;
    if (row.width != width) flush();
    width = row.width;
    vectors[found] = dense_.at(row.dense), weights[found++] = row.weight;
    if (found == kTogether) flush();
  }
  flush();
}

// What rows add by entries.
void StepProgram::add_others(const Row& row) {
  for (integer k = row.sparse; k < row.end; ++k) {
    const Entry one = entries_[k];
    const double factor = row.weight * one.value;
    if (!row.is_sparse) {
      factor_.add_cross(one.variable - band_, row.first, row.width, dense_.at(row.dense), factor);
    }
    for (integer l = row.sparse; l <= k; ++l) {
      const Entry other = entries_[l];
      const bool is_before = other.variable <= one.variable;
      factor_.add(is_before ? other.variable : one.variable,
                  is_before ? one.variable : other.variable, factor * other.value);
    }
  }
}

// The direction in which all products become the target, less a share of what the last direction
// makes of them to second order.
void StepProgram::aim(double target, double second) {
  const integer pairs = s_.size();
  double *s = s_.at(0), *z = z_.at(0), *ds = ds_.at(0), *dz = dz_.at(0), *wanted = wanted_.at(0);
  for (integer k = 0; k < pairs; ++k) {
    wanted[k] = (target - second * ds[k] * dz[k]) / s[k] - z[k];
  }
  for (integer i = 0; i < size_; ++i) {
    dx_[i] = wanted[i] - gradient_[i];
    if (z[size_ + i] > 0) dx_[i] -= wanted[size_ + i];
  }
  for (integer r = 0; r < rows_.size(); ++r) {
    const Row& row = rows_[r];
    collect(row, -(wanted[2 * size_ + r] + row.weight * row.residual), dx_.at(0));
  }
  factor_.solve(dx_.at(0));
  for (integer i = 0; i < size_; ++i) {
    ds[i] = dx_[i], ds[size_ + i] = z[size_ + i] > 0 ? -dx_[i] : 0.0;
  }
  for (integer r = 0; r < rows_.size(); ++r) {
    ds[2 * size_ + r] = -rows_[r].residual - used(rows_[r], dx_.at(0));
  }
  for (integer k = 0; k < pairs; ++k) {
    dz[k] = z[k] > 0 ? wanted[k] - z[k] / s[k] * ds[k] : 0.0;
  }
}

// How long a step may be until a first value is used up.
double StepProgram::longest(const Array<double>& value, const Array<double>& change) const {
  const double *from = value.at(0), *by = change.at(0);
  double most = 0.0;
#pragma omp simd reduction(max : most)
  for (integer k = 0; k < value.size(); ++k) {
    const double share = -by[k] / (from[k] + 1e-300);
    most = share > most ? share : most;
  }
  return 1.0 / larger(most, 1e-300);
}

bool StepProgram::solve(double tolerance, integer most_iterations) {
  factor_.shape(band_, width_, size_ - band_);
  const bool goes_on = has_started_;
  return get_near(tolerance, most_iterations) || (goes_on && get_near(tolerance, most_iterations));
}

// Goes on from where it is, or begins; what does not get near is forgotten.
bool StepProgram::get_near(double tolerance, integer most_iterations) {
  if (!has_started_) start();
  for (integer r = 0; r < rows_.size(); ++r) {
    rows_[r].residual = used(rows_[r], x_.at(0)) + s_[2 * size_ + r] - rows_[r].slack;
  }
  double least = kHopeless;
  for (integer iteration = 0, nearest = 0;; ++iteration) {
    evaluate();
    const double off = larger(infeasible_, mean_ * s_.size());
    if (off < tolerance) return true;
    if (off < least) least = off, nearest = iteration, nearest_.take(x_, s_, z_, mean_);
    if (!(off < kHopeless) || iteration == most_iterations) break;
    if (iteration - nearest == kPatience) break;
    if (mean_ * s_.size() > kCentral) kept_.take(x_, s_, z_, mean_);
    ++iterations_;
    step();
  }
  has_started_ = least < smaller(kAlmost * tolerance, kAlmostMost);
  if (has_started_) nearest_.give(x_, s_, z_, &mean_);
  return has_started_;
}

// One step: first towards products of zero, then as far from there as that one got.
void StepProgram::step() {
  assemble();
  aim(0.0, 0.0);
  const double primal = smaller(longest(s_, ds_), 1.0), dual = smaller(longest(z_, dz_), 1.0);
  const double share = product(primal, dual) / (mean_ * s_.size());
  aim(share * share * share * mean_, primal * dual);
  const double far = smaller(kShare * longest(s_, ds_), 1.0);
  const double high = smaller(kShare * longest(z_, dz_), 1.0);
  for (integer i = 0; i < size_; ++i) x_[i] += far * dx_[i];
  for (integer r = 0; r < rows_.size(); ++r) rows_[r].residual *= 1.0 - far;
  for (integer k = 0; k < s_.size(); ++k) s_[k] += far * ds_[k], z_[k] += high * dz_[k];
}

void StepProgram::read(double* x, double* multipliers) const {
  for (integer i = 0; i < size_; ++i) x[i] = x_[i];
  for (integer r = 0; r < rows_.size(); ++r) multipliers[r] = z_[2 * size_ + r];
}

TUBEPLANNER_API void* step_program_new(integer size, integer band, const double* first,
                                       const double* linear, const double* lower,
                                       const double* upper) {
  void* place = std::malloc(sizeof(StepProgram));
  return place == nullptr ? nullptr : new (place) StepProgram(size, band, first, linear, lower, upper);
}

TUBEPLANNER_API void step_program_delete(void* program) {
  static_cast<StepProgram*>(program)->~StepProgram();
  std::free(program);
}

TUBEPLANNER_API void step_program_add_quadratic(void* program, integer count, const integer* row,
                                                const integer* column, const double* value) {
  static_cast<StepProgram*>(program)->add_quadratic(count, row, column, value);
}

TUBEPLANNER_API void step_program_add_rows(void* program, integer count, const integer* entries,
                                           const integer* column, const double* value,
                                           const double* slack) {
  static_cast<StepProgram*>(program)->add_rows(count, entries, column, value, slack);
}

TUBEPLANNER_API void step_program_set_slack(void* program, const double* slack) {
  static_cast<StepProgram*>(program)->set_slack(slack);
}

TUBEPLANNER_API int step_program_solve(void* program, double tolerance, integer most_iterations) {
  return static_cast<StepProgram*>(program)->solve(tolerance, most_iterations);
}

TUBEPLANNER_API integer step_program_read(void* program, double* x, double* multipliers) {
  static_cast<StepProgram*>(program)->read(x, multipliers);
  return static_cast<StepProgram*>(program)->iterations();
}
