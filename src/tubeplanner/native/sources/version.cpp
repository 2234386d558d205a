// Which build this is, and whether the processor runs a newer one.
#include "numerics.h"

TUBEPLANNER_API const char* tubeplanner_sources() { return TUBEPLANNER_SOURCES; }

TUBEPLANNER_API const char* tubeplanner_level() { return TUBEPLANNER_LEVEL; }

TUBEPLANNER_API const char* tubeplanner_compiler() { return TUBEPLANNER_COMPILER; }

TUBEPLANNER_API int tubeplanner_runs_v3() {
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
           __builtin_cpu_supports("bmi2");
#else
    return 0;
#endif
}
