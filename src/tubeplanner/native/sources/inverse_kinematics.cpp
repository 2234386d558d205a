// Configurations in which the tool has given positions and rotations, by damped least squares.
//
// Counterpart of tubeplanner/first_guess/inverse_kinematics.py, which explains the method.
#include <cstdlib>
#include <cstring>

#include "chain.h"
#include "rotations.h"

static const double PI = 3.14159265358979323846;

// As the Python module's constants, in this order.
struct Settings {
    double damping, position_tolerance, posture_tolerance, max_iterations, pulled_iterations;
    double max_step, redundant_gain, bends[2];
};

struct Goal {
    const double *position, *lower, *upper, *preferred;
    const double *reference, *vector;  // null: any rotation
    const bool* components;
};

// What a step should do; its directions and inverse squared gains as a step used them.
struct Task {
    integer rows;
    double error[3], inverse[3];
    double *jacobian, *directions;
};

struct Solution {
    double *q, error, rotation_error;
};

static double dot(const double* a, const double* b, integer count) {
    double sum = 0;
    for (integer i = 0; i < count; ++i) sum += a[i] * b[i];
    return sum;
}

static double largest(const double* values, integer count) {
    double found = 0;
    for (integer i = 0; i < count; ++i)
        if (!(std::fabs(values[i]) <= found)) found = std::fabs(values[i]);
    return found;
}

static double bounded(double value, double lower, double upper) {
    value = value < lower ? lower : value;
    return value > upper ? upper : value;
}

// Replace a rotation vector by that of the turn the other way round if it is nearer to another.
static void take_nearest_branch(double* v, const double* near, const bool* components) {
    double angle = std::sqrt(dot(v, v, 3)), factor = 1 - 2 * PI / angle, gain = 0;
    if (angle <= PI / 2) return;
    for (int i = 0; i < 3; ++i)
        if (components[i]) gain += std::fabs(v[i] - near[i]) - std::fabs(factor * v[i] - near[i]);
    for (int i = 0; i < 3 && gain > 0; ++i) v[i] *= factor;
}

// Turn a symmetric matrix (3, 3), of which `rows` count, diagonal (Jacobi); its vectors are rows.
static void diagonalize(double a[3][3], double vectors[3][3], integer rows) {
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) vectors[i][j] = i == j;
    for (int sweep = 0; sweep < 30; ++sweep) {
        double off = 0;
        for (integer p = 0; p < rows; ++p)
            for (integer r = p + 1; r < rows; ++r) {
                if (a[p][r] == 0) continue;
                off += std::fabs(a[p][r]) > 1e-18 * (std::fabs(a[p][p]) + std::fabs(a[r][r]));
                double theta = (a[r][r] - a[p][p]) / (2 * a[p][r]);
                double t = (theta < 0 ? -1 : 1) / (std::fabs(theta) + std::sqrt(theta * theta + 1));
                double c = 1 / std::sqrt(t * t + 1), s = t * c, moved = t * a[p][r];
                a[p][p] -= moved, a[r][r] += moved, a[p][r] = a[r][p] = 0;
                for (integer k = 0; k < 3; ++k) {
                    if (k < rows && k != p && k != r) {
                        double first = a[k][p], second = a[k][r];
                        a[k][p] = a[p][k] = c * first - s * second;
                        a[k][r] = a[r][k] = s * first + c * second;
                    }
                    double first = vectors[p][k], second = vectors[r][k];
                    vectors[p][k] = c * first - s * second;
                    vectors[r][k] = s * first + c * second;
                }
            }
        if (off == 0) return;
    }
}

class Descent {
  public:
    Descent(const Joint* joints, integer count, integer n, const Settings& settings, double* memory)
        : joints(joints), count(count), n(n), settings(settings) {
        double** parts[] = {&q, &last, &pull, &step, &ahead, &masked};
        for (double** part : parts) *part = memory, memory += n;
        for (Task& task : tasks) task.directions = memory, memory += 3 * n;
        jacobian = memory, turned = memory + 6 * n, frames = memory + 9 * n;
    }

    static integer memory_needed(integer count, integer n) { return 21 * n + 6 * count; }

    // Set where damped steps from a seed lead to.
    void run(const Goal& goal, const double* seed, Solution& found) {
        double least = INFINITY;
        for (integer i = 0; i < n; ++i)
            q[i] = last[i] = bounded(seed[i], goal.lower[i], goal.upper[i]);
        for (integer iteration = 0; iteration < settings.max_iterations; ++iteration) {
            set_tasks(goal);
            double off = length(0), turned_off = length(1);
            double tolerance = settings.position_tolerance;
            bool pulled = iteration < settings.pulled_iterations;
            if (!pulled && off > (tolerance > least ? tolerance : least)) {
                // A step beyond a target out of reach.
                for (integer i = 0; i < n; ++i) q[i] = (last[i] + q[i]) / 2;
                continue;
            }
            least = off;
            for (integer i = 0; i < n; ++i) {
                last[i] = q[i];
                pull[i] = pulled ? goal.preferred[i] - q[i] : 0.0;
            }
            move(goal);
            for (integer i = 0; i < n; ++i) step[i] = q[i] - last[i];
            if (largest(step, n) < settings.posture_tolerance) {
                // Over so short a step the errors change as their Jacobians say.
                for (integer k = 0; k < task_count; ++k)
                    for (integer r = 0; r < tasks[k].rows; ++r)
                        tasks[k].error[r] -= dot(tasks[k].jacobian + r * n, step, n);
                return end(found);
            }
            if (!pulled && (off > turned_off ? off : turned_off) < tolerance) break;
        }
        set_tasks(goal);
        end(found);
    }

  private:
    const Joint* joints;
    integer count, n, task_count = 0;
    const Settings& settings;
    double *q, *last, *pull, *step, *ahead, *masked, *jacobian, *turned, *frames;
    Task tasks[2];

    double length(integer k) const {
        return k < task_count ? std::sqrt(dot(tasks[k].error, tasks[k].error, tasks[k].rows)) : 0.0;
    }

    void end(Solution& found) const {
        std::memcpy(found.q, q, n * sizeof(double));
        found.error = length(0), found.rotation_error = length(1);
    }

    void set_tasks(const Goal& goal) {
        double rotation[9], position[3];
        last_pose(joints, count, n, q, frames, rotation, position, jacobian);
        task_count = 1, tasks[0].rows = 3, tasks[0].jacobian = jacobian;
        for (int i = 0; i < 3; ++i) tasks[0].error[i] = goal.position[i] - position[i];
        if (goal.reference != nullptr &&
            (goal.components[0] || goal.components[1] || goal.components[2]))
            set_rotation_task(goal, rotation);
    }

    void set_rotation_task(const Goal& goal, const double* rotation) {
        double relative[9], vector[3], turning[9], row[3];
        relative_rotation(goal.reference, rotation, relative);
        rotation_vector(relative, vector);
        take_nearest_branch(vector, goal.vector, goal.components);
        inverse_right_jacobian(vector, turning);
        Task& task = tasks[1];
        task_count = 2, task.rows = 0, task.jacobian = turned;
        for (int i = 0; i < 3; ++i) {
            if (!goal.components[i]) continue;
            task.error[task.rows] = goal.vector[i] - vector[i];
            for (int j = 0; j < 3; ++j) row[j] = times(rotation, j, turning + 3 * i);
            const double* angular = jacobian + 3 * n;
            for (integer k = 0; k < n; ++k)
                turned[task.rows * n + k] =
                    row[0] * angular[k] + row[1] * angular[n + k] + row[2] * angular[2 * n + k];
            ++task.rows;
        }
    }

    // Move q by a step; joints pushed out of their bounds are held still.
    void move(const Goal& goal) {
        for (integer i = 0; i < n; ++i) masked[i] = 1;
        for (integer round = 0; round <= n; ++round) {
            set_free_step();
            double size = largest(step, n);
            double share = settings.max_step / (size > 1e-300 ? size : 1e-300);
            bool outward = false;
            for (integer i = 0; i < n; ++i) {
                double there = q[i] + step[i] * (share < 1 ? share : 1);
                ahead[i] = bounded(there, goal.lower[i], goal.upper[i]);
                if (ahead[i] != there && ahead[i] == q[i]) masked[i] = 0, outward = true;
            }
            if (!outward) break;
        }
        std::memcpy(q, ahead, n * sizeof(double));
    }

    // Set the step of joints without bounds: each task in the null space of those before.
    void set_free_step() {
        for (integer i = 0; i < n; ++i) step[i] = 0;
        for (integer k = 0; k < task_count; ++k) add_task(k);
        for (integer k = 0; k < task_count; ++k)
            for (integer r = 0; r < tasks[k].rows; ++r) {
                const double* direction = tasks[k].directions + r * n;
                double pulled = dot(direction, pull, n) * tasks[k].inverse[r];
                for (integer i = 0; i < n; ++i) step[i] -= pulled * direction[i];
            }
        for (integer i = 0; i < n; ++i) step[i] += masked[i] * pull[i];
    }

    void add_task(integer k) {
        Task& task = tasks[k];
        double remaining[3], squared[3][3] = {}, vectors[3][3], gain[3];
        double redundant = settings.redundant_gain * settings.redundant_gain;
        double* left = task.directions;
        for (integer r = 0; r < task.rows; ++r)
            for (integer i = 0; i < n; ++i) left[r * n + i] = masked[i] * task.jacobian[r * n + i];
        for (integer before = 0; before < k; ++before) remove(tasks[before], task);
        for (integer r = 0; r < task.rows; ++r) {
            remaining[r] = task.error[r] - dot(task.jacobian + r * n, step, n);
            for (integer c = 0; c <= r; ++c)
                squared[r][c] = squared[c][r] = dot(left + r * n, left + c * n, n);
        }
        diagonalize(squared, vectors, task.rows);
        double damping = 0.5 * dot(task.error, task.error, task.rows) + settings.damping;
        for (integer r = 0; r < task.rows; ++r) {
            double own = squared[r][r];
            gain[r] = dot(vectors[r], remaining, task.rows) / (own + damping);
            task.inverse[r] = own > redundant ? 1 / own : 0.0;
        }
        for (integer i = 0; i < n; ++i) {
            double column[3] = {};
            for (integer r = 0; r < task.rows; ++r) column[r] = left[r * n + i];
            for (integer r = 0; r < task.rows; ++r) {
                left[r * n + i] = dot(vectors[r], column, task.rows);
                step[i] += gain[r] * left[r * n + i];
            }
        }
    }

    // Take the directions of one task out of another's.
    void remove(const Task& before, Task& task) const {
        for (integer r = 0; r < task.rows; ++r) {
            double *row = task.directions + r * n, along[3];
            for (integer d = 0; d < before.rows; ++d)
                along[d] = dot(row, before.directions + d * n, n) * before.inverse[d];
            for (integer d = 0; d < before.rows; ++d)
                for (integer i = 0; i < n; ++i) row[i] -= along[d] * before.directions[d * n + i];
        }
    }
};

// Set configurations (N, n) within bounds (N, n), and their errors (N, 2) of position and rotation,
// of a tool that is the last of `count` bodies, each of which carries the next; N seeds, preferred
// configurations (N, n), positions (N, 3), references (N, 3, 3), wanted rotation vectors (N, 3) and
// which of their components count (N, 3), all three null if no rotation is wanted. Return 0, or 1
// if there is no memory.
TUBEPLANNER_API int tubeplanner_solve_positions(
    const double* table, integer count, integer n, const double* settings, integer samples,
    const double* position, const double* seed, const double* lower, const double* upper,
    const double* preferred, const double* reference, const double* vector, const bool* components,
    double* q, double* errors) {
    const Settings& given = *reinterpret_cast<const Settings*>(settings);
    integer needed = Descent::memory_needed(count, n) + 2 * n;
    double* memory = static_cast<double*>(std::malloc(needed * sizeof(double)));
    if (memory == nullptr) return 1;
    Descent descent(reinterpret_cast<const Joint*>(table), count, n, given, memory + 2 * n);
    double reached = std::sqrt(given.position_tolerance);
    for (integer s = 0; s < samples; ++s) {
        Goal goal = {position + 3 * s, lower + n * s, upper + n * s, preferred + n * s, 0, 0, 0};
        if (reference != nullptr) {
            goal.reference = reference + 9 * s, goal.vector = vector + 3 * s;
            goal.components = components + 3 * s;
        }
        Solution best = {q + n * s, 0, 0}, other = {memory, 0, 0};
        descent.run(goal, seed + n * s, best);
        for (int k = 0; k < 2 && !(best.error < reached); ++k) {
            double* bent = memory + n;
            for (integer i = 0; i < n; ++i) bent[i] = best.q[i] + given.bends[k] * (i % 2 ? -1 : 1);
            descent.run(goal, bent, other);
            if (other.error < best.error) {
                std::memcpy(best.q, other.q, n * sizeof(double));
                best.error = other.error, best.rotation_error = other.rotation_error;
            }
        }
        errors[2 * s] = best.error, errors[2 * s + 1] = best.rotation_error;
    }
    std::free(memory);
    return 0;
}
