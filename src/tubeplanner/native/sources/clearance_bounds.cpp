// Lower bounds on how far pairs of convex shapes are apart in many configurations.
//
// Counterpart of tubeplanner/studies/tubes/clearance_bounds.py, which explains them.
#include <cmath>
#include <cstdlib>

#include "numerics.h"

// A convex shape in the frame of its body, as a row of a table of doubles.
struct Shape {
    double body, first, count;  // what carries it; its vertices among those of all shapes
    double radius, bounding;    // by which its vertices are grown; of the sphere about its centre
    double center[3];
    double axes[9], middle[3], half[3];  // of the box around it
};

// As the Python modules' constants, in this order.
struct Settings {
    double max_steps, loose, no_length;
};

struct Pose {
    const double *rotation, *position;
};

// Vertices of all shapes by coordinate, and as many numbers to write to as any shape has vertices.
struct Vertices {
    const double *x, *y, *z;
    double* products;
};

static double dot(const double* a, const double* b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void placed(const Pose& pose, const double* local, double* point) {
    for (int i = 0; i < 3; ++i) point[i] = dot(pose.rotation + 3 * i, local) + pose.position[i];
}

// Set a vector of the base frame in the frame of a body.
static void turned_back(const Pose& pose, const double* v, double* local) {
    for (int i = 0; i < 3; ++i)
        local[i] = pose.rotation[i] * v[0] + pose.rotation[3 + i] * v[1] + pose.rotation[6 + i] * v[2];
}

// Set the vertex of a shape that is farthest along a direction.
static void farthest(const Shape& shape, const Vertices& of, const double* along, double* vertex) {
    integer first = integer(shape.first), count = integer(shape.count), best = 0;
    const double *x = of.x + first, *y = of.y + first, *z = of.z + first;
    double *products = of.products, most = -INFINITY;
    for (integer k = 0; k < count; ++k)
        products[k] = along[0] * x[k] + along[1] * y[k] + along[2] * z[k];
#pragma omp simd reduction(max : most)
    for (integer k = 0; k < count; ++k) most = products[k] > most ? products[k] : most;
    while (best < count - 1 && products[best] != most) ++best;
    vertex[0] = x[best], vertex[1] = y[best], vertex[2] = z[best];
}

static double box_distance(const Shape& shape, const Pose& pose, const double* point) {
    double away[3], local[3], squared = 0;
    for (int i = 0; i < 3; ++i) away[i] = point[i] - pose.position[i];
    turned_back(pose, away, local);
    for (int i = 0; i < 3; ++i) {
        double beyond = std::fabs(dot(shape.axes + 3 * i, local) - shape.middle[i]) - shape.half[i];
        squared += beyond > 0 ? beyond * beyond : 0.0;
    }
    return std::sqrt(squared);
}

// Return how far the hulls of two shapes are apart along a direction that Gilbert's iteration finds
// from the gap between two of their points; in the base frame.
static double separation(const Shape& first, const Pose& own, const Shape& second,
                         const Pose& other, const Vertices& vertices, double* gap, double enough,
                         const Settings& settings) {
    double bound = -INFINITY, known = INFINITY;
    for (integer step = 0; step < settings.max_steps; ++step) {
        double length = std::sqrt(dot(gap, gap)), wanted = known - settings.loose;
        if (length <= settings.no_length || bound >= (enough < wanted ? enough : wanted)) break;
        known = length;
        double along[3], local[3], vertex[3], support[3], end[3], edge[3];
        for (int i = 0; i < 3; ++i) along[i] = gap[i] / length;
        turned_back(own, along, local);
        farthest(first, vertices, local, vertex);
        placed(own, vertex, support);
        turned_back(other, along, local);
        for (double& value : local) value = -value;
        farthest(second, vertices, local, vertex);
        placed(other, vertex, end);
        for (int i = 0; i < 3; ++i) end[i] -= support[i], edge[i] = end[i] - gap[i];
        double apart = dot(along, end), squared = dot(edge, edge), share = -dot(gap, edge);
        double least = settings.no_length * settings.no_length;
        if (apart > bound) bound = apart;
        share /= squared > least ? squared : least;
        share = share < 0 ? 0 : share > 1 ? 1 : share;
        for (int i = 0; i < 3; ++i) gap[i] += share * edge[i];
    }
    return bound;
}

// Return a bound on the clearance of a pair whose spheres are not enough apart.
static double pair_bound(const Shape* const* shapes, const Pose* poses, const double* const* centers,
                         const Vertices& vertices, double required, double near,
                         const Settings& settings) {
    for (int ball = 0; ball < 2; ++ball) {
        int box = 1 - ball;
        double apart = box_distance(*shapes[box], poses[box], centers[ball]);
        if (apart - shapes[ball]->bounding - required >= near) return INFINITY;
    }
    double gap[3], grown = shapes[0]->radius + shapes[1]->radius;
    for (int i = 0; i < 3; ++i) gap[i] = centers[1][i] - centers[0][i];
    double apart = separation(*shapes[0], poses[0], *shapes[1], poses[1], vertices, gap,
                              near + required + grown, settings);
    return apart - grown - required < near ? apart - grown - required : INFINITY;
}

// Set bounds (N, P), infinite from `near` on, of P pairs (P, 2) of S shapes with V vertices (3, V),
// of which `required` (P,) is asked, where bodies are: rotations (N, B, 3, 3), origins (N, B, 3);
// and each configuration's least one, (N,). Return 0, or 1 if there is no memory.
TUBEPLANNER_API int tubeplanner_clearance_bounds(
    const double* table, integer shape_count, const double* vertices, integer vertex_count,
    const integer* pairs, const double* required, integer pair_count, const double* settings,
    const double* rotation, const double* position, integer bodies, integer samples, double near,
    double* bound, double* least) {
    const Shape* shapes = reinterpret_cast<const Shape*>(table);
    integer size = 3 * shape_count + vertex_count;
    double* memory = static_cast<double*>(std::malloc(size * sizeof(double)));
    if (memory == nullptr) return 1;
    double* centers = memory + vertex_count;
    Vertices of = {vertices, vertices + vertex_count, vertices + 2 * vertex_count, memory};
    for (integer s = 0; s < samples; ++s, rotation += 9 * bodies, position += 3 * bodies) {
        for (integer k = 0; k < shape_count; ++k) {
            integer body = integer(shapes[k].body);
            placed({rotation + 9 * body, position + 3 * body}, shapes[k].center, centers + 3 * k);
        }
        least[s] = INFINITY;
        for (integer p = 0; p < pair_count; ++p, ++bound) {
            *bound = INFINITY;
            const Shape* two[2];
            const double* at[2];
            double gap[3];
            for (int k = 0; k < 2; ++k)
                two[k] = shapes + pairs[2 * p + k], at[k] = centers + 3 * pairs[2 * p + k];
            for (int i = 0; i < 3; ++i) gap[i] = at[1][i] - at[0][i];
            double reach = near + required[p] + two[0]->bounding + two[1]->bounding;
            if (reach <= 0 || dot(gap, gap) >= reach * reach) continue;
            Pose poses[2];
            for (int k = 0; k < 2; ++k) {
                integer body = integer(two[k]->body);
                poses[k] = {rotation + 9 * body, position + 3 * body};
            }
            *bound = pair_bound(two, poses, at, of, required[p], near,
                                *reinterpret_cast<const Settings*>(settings));
            if (*bound < least[s]) least[s] = *bound;
        }
    }
    std::free(memory);
    return 0;
}
