// A convex quadratic program whose rows are short and banded but for a few variables.
//
// It minimises x.Qx / 2 + c.x under Ax <= b and lower <= x <= upper.
#pragma once

#include "arrow_factor.h"

class StepProgram {
 public:
  StepProgram(integer size, integer band, const double* first, const double* linear,
              const double* lower, const double* upper);
  void add_quadratic(integer count, const integer* row, const integer* column,
                     const double* value);
  // Rows may be added at any time; those known already keep their multipliers.
  void add_rows(integer count, const integer* entries, const integer* column, const double* value,
                const double* slack);
  // Other slack for all rows: the next solution begins anew.
  void set_slack(const double* slack);
  // Goes on from where it is, or from the beginning where that fails; returns whether it gets
  // there, or almost, where rounding lets nothing get nearer.
  bool solve(double tolerance, integer most_iterations);
  void read(double* x, double* multipliers) const;
  integer iterations() const { return iterations_; }

 private:
  struct Entry {
    integer variable;
    double value;
  };
  struct Row {
    integer first, width, dense;  // in the band: variables, and where they begin in `dense_`
    integer sparse, others, end;  // in `entries_`: those of the band, if they are few; the others
    bool is_sparse;
    double slack, residual, weight;
  };

  // Where variables, slacks and multipliers were, and the mean product.
  class Place {
   public:
    bool is_empty() const { return x_.size() == 0; }
    void forget() { x_.resize(0); }
    void take(const Array<double>& x, const Array<double>& s, const Array<double>& z, double mean);
    // Returns how many slacks and multipliers there were.
    integer give(Array<double>& x, Array<double>& s, Array<double>& z, double* mean) const;

   private:
    Array<double> x_, s_, z_;
    double mean_ = 0.0;
  };

  void go_back();
  void put(integer first, const Entry& entry);
  bool get_near(double tolerance, integer most_iterations);
  void step();
  void start();
  void start_row(integer row, double least);
  double used(const Row& row, const double* x) const;
  void collect(const Row& row, double factor, double* to) const;
  void evaluate();
  void assemble();
  void add_dense(integer begin, integer end);
  void add_others(const Row& row);
  void aim(double target, double second);
  double longest(const Array<double>& value, const Array<double>& change) const;
  double product(double primal, double dual) const;

  integer size_, band_, width_ = 0, iterations_ = 0;
  bool has_started_ = false;
  double infeasible_ = 0.0, mean_ = 0.0;
  Array<double> first_, linear_, lower_, upper_, x_, dx_, gradient_, dense_;
  // Slacks and multipliers, of all variables' lower bounds, of their upper bounds, and of rows;
  // how they change; and what their products are to become.
  Array<double> s_, z_, ds_, dz_, wanted_;
  Place kept_, nearest_;  // where rows that join find room; where it was the least off
  Array<Row> rows_;
  Array<Entry> entries_, quadratic_;
  Array<integer> quadratic_row_, order_;
  ArrowFactor factor_;
};
