// Configurations moved until the tool is where it is wanted, or as near to it as it comes.
//
// Counterpart of tubeplanner/studies/tubes/configuration_sets.py, which explains the method.
#include <cstdlib>
#include <cstring>

#include "chain.h"
#include "rotations.h"

// As the Python module's constants, in this order.
struct Settings {
    double max_steps, max_step, still, damping;
};

struct Wanted {
    const double* position;
    const double *reference, *vector;  // null: any rotation
    const bool* components;
};

static const int ROWS = 6;

// The steps of one configuration (n,) after the other; `memory` holds 13 n + 6 count doubles.
class Mover {
  public:
    Mover(const Joint* joints, integer count, integer n, const double* lower, const double* upper,
          const Settings& settings, double* memory)
        : joints(joints), count(count), n(n), lower(lower), upper(upper), settings(settings) {
        step = memory, jacobian = memory + n, task = memory + 7 * n, frames = memory + 13 * n;
    }

    static integer memory_needed(integer count, integer n) { return 13 * n + 6 * count; }

    // Move a configuration; `close` is how near to position [m] and rotation [rad] is near enough.
    void move(double* q, const Wanted& wanted, const double* close) {
        for (integer k = 0; k < settings.max_steps; ++k) {
            set_task(q, wanted);
            if (length(0, 3) <= close[0] && length(3, rows) <= close[1]) return;
            set_step(q);
            double most = 0, largest = settings.max_step, size = 0;
            for (integer i = 0; i < n; ++i)
                if (std::fabs(step[i]) > largest) largest = std::fabs(step[i]);
            double share = settings.max_step / largest;
            for (integer i = 0; i < n; ++i) {
                double ahead = q[i] + share * step[i];
                ahead = ahead < lower[i] ? lower[i] : ahead;
                ahead = ahead > upper[i] ? upper[i] : ahead;
                size = std::fabs(ahead - q[i]), most = size > most ? size : most;
                q[i] = ahead;
            }
            if (most < settings.still) return;
        }
    }

  private:
    const Joint* joints;
    integer count, n, rows = 3;
    const double *lower, *upper;
    const Settings& settings;
    double *step, *jacobian, *task, *frames, error[ROWS];

    double length(integer begin, integer end) const {
        double squared = 0;
        for (integer r = begin; r < end; ++r) squared += error[r] * error[r];
        return std::sqrt(squared);
    }

    // Set what is missing, and as rows of `task` (rows, n) how joints change it.
    void set_task(const double* q, const Wanted& wanted) {
        double rotation[9], position[3], relative[9], vector[3], turning[9], row[3];
        last_pose(joints, count, n, q, frames, rotation, position, jacobian);
        for (int i = 0; i < 3; ++i) error[i] = wanted.position[i] - position[i];
        std::memcpy(task, jacobian, 3 * n * sizeof(double));
        rows = 3;
        if (wanted.reference == nullptr) return;
        relative_rotation(wanted.reference, rotation, relative);
        rotation_vector(relative, vector);
        inverse_right_jacobian(vector, turning);
        const double* angular = jacobian + 3 * n;
        for (int i = 0; i < 3; ++i) {
            if (!wanted.components[i]) continue;
            error[rows] = wanted.vector[i] - vector[i];
            for (int j = 0; j < 3; ++j) row[j] = times(rotation, j, turning + 3 * i);
            for (integer k = 0; k < n; ++k)
                task[rows * n + k] =
                    row[0] * angular[k] + row[1] * angular[n + k] + row[2] * angular[2 * n + k];
            ++rows;
        }
    }

    // Set the damped step; joints at a bound are not pushed outwards.
    void set_step(const double* q) {
        for (int round = 0; round < 2; ++round) {
            double pull[ROWS];
            solve(pull);
            for (integer i = 0; i < n; ++i) {
                step[i] = 0;
                for (integer r = 0; r < rows; ++r) step[i] += task[r * n + i] * pull[r];
                bool outward = step[i] < 0 ? q[i] <= lower[i] : step[i] > 0 && q[i] >= upper[i];
                for (integer r = 0; r < rows && outward; ++r) task[r * n + i] = 0;
            }
        }
    }

    // Solve (J J^T + damping) pull = error (Cholesky).
    void solve(double* pull) const {
        double factor[ROWS][ROWS];
        for (integer r = 0; r < rows; ++r) {
            pull[r] = error[r];
            for (integer c = 0; c <= r; ++c) {
                double sum = r == c ? settings.damping : 0.0;
                for (integer i = 0; i < n; ++i) sum += task[r * n + i] * task[c * n + i];
                for (integer k = 0; k < c; ++k) sum -= factor[r][k] * factor[c][k];
                factor[r][c] = r == c ? std::sqrt(sum) : sum / factor[c][c];
            }
            for (integer c = 0; c < r; ++c) pull[r] -= factor[r][c] * pull[c];
            pull[r] /= factor[r][r];
        }
        for (integer r = rows - 1; r >= 0; --r) {
            for (integer c = r + 1; c < rows; ++c) pull[r] -= factor[c][r] * pull[c];
            pull[r] /= factor[r][r];
        }
    }
};

// Move configurations (N, n) within bounds (n,) until the tool, the last of `count` bodies, each of
// which carries the next, is at positions (N, 3) and turned against references (N, 3, 3) by vectors
// (N, 3) in those components that count (3,); these three are null if any rotation will do. Return
// 0, or 1 if there is no memory.
TUBEPLANNER_API int tubeplanner_move_tools(const double* table, integer count, integer n,
                                           const double* settings, const double* close,
                                           const double* lower, const double* upper,
                                           integer samples, const double* position,
                                           const double* reference, const double* vector,
                                           const bool* components, double* q) {
    double* memory = static_cast<double*>(
        std::malloc(Mover::memory_needed(count, n) * sizeof(double)));
    if (memory == nullptr) return 1;
    Mover mover(reinterpret_cast<const Joint*>(table), count, n, lower, upper,
                *reinterpret_cast<const Settings*>(settings), memory);
    for (integer s = 0; s < samples; ++s) {
        Wanted wanted = {position + 3 * s, nullptr, nullptr, components};
        if (reference != nullptr)
            wanted.reference = reference + 9 * s, wanted.vector = vector + 3 * s;
        mover.move(q + n * s, wanted, close);
    }
    std::free(memory);
    return 0;
}
