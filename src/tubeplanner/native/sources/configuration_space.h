// Straight edges in the space of an arm's joints along which pairs of shapes keep distances.
//
// Counterpart of `FreeSpace.is_free_edge` in tubeplanner/first_guess/joint_routes.py, which
// explains it.
#pragma once

#include "array.h"
#include "chain.h"
#include "convex_pairs.h"

// Pairs of shapes, and the distances that they must keep. The first `groups` rows are shapes around
// others, `members` are the rows of the pairs inside; a group without members is a pair itself.
struct PairRows {
    const Shapes* shapes;
    integer rows, groups;
    const integer* pairs;    // (rows, 2)
    const integer* members;  // (groups + 1): where the members of each group begin
    const double* required;  // (rows,) [m]
    const double* weights;   // (rows, n): change of the distance by change of the joints, at most
    // Near an end of the motion some pairs need not be as far apart.
    integer ends;
    const double* end_tools;      // (ends, 4): the tool's position there, and how near is near [m]
    const double* end_required;   // (ends, rows) [m], infinite where the end changes nothing
    const double* tool;           // (n + 4): its body, its position there, its weights
    double resolution;            // change of a distance between places that is not looked at [m]
    double* directions;           // (rows, 3): along which each pair was last separated
    integer* order;               // (groups,): which comes first; the last collision does
};

// The edge that is tested; its places have dyadic numbers from 0 to `LAST`.
class Edges {
  public:
    static const integer LAST = integer(1) << 20;

    Edges(const PairRows& pairs, const Joint* joints, integer joint_count, integer n);

    // Return true if the end of an edge from a free configuration and all between are free.
    bool is_free(const double* from, const double* to);

  private:
    const PairRows& pairs_;
    const Joint* joints_;
    integer bodies_, n_, stamp_ = 0, used_ = 0, slots_ = 0;
    const double *from_ = nullptr, *to_ = nullptr;
    double tool_weight_ = 0;
    Array<double> q_, rotation_, position_, weight_, reach_;
    Array<integer> table_, stamps_, keys_;
    Array<bool> placed_;

    integer slot(integer place);
    void put(integer slot, integer body);
    double distance(integer row, integer slot, double enough);
    double cover(integer row, integer place, double enough);
    bool is_free_between(integer row, integer low, integer high, double below, double above);
    bool fail(integer at);
};
