// Which build this is, and whether the processor runs a newer one.
#if defined(__x86_64__)
#include <cpuid.h>
#endif

#include "numerics.h"

TUBEPLANNER_API const char* tubeplanner_sources() { return TUBEPLANNER_SOURCES; }

TUBEPLANNER_API const char* tubeplanner_level() { return TUBEPLANNER_LEVEL; }

TUBEPLANNER_API const char* tubeplanner_compiler() { return TUBEPLANNER_COMPILER; }

// Whether the processor has what x86-64-v3 may use, and the system keeps its wide registers; asked
// of the processor itself, as not every compiler's run time knows.
TUBEPLANNER_API int tubeplanner_runs_v3() {
#if defined(__x86_64__)
    const unsigned basic = bit_FMA | bit_MOVBE | bit_OSXSAVE | bit_AVX | bit_F16C;
    const unsigned further = bit_AVX2 | bit_BMI | bit_BMI2, wide = 6;
    unsigned a, b, c, d, kept;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & basic) != basic) return 0;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || (b & further) != further) return 0;
    if (!__get_cpuid(0x80000001, &a, &b, &c, &d) || !(c & bit_LZCNT)) return 0;
    __asm__("xgetbv" : "=a"(kept), "=d"(d) : "c"(0));
    return (kept & wide) == wide;
#else
    return 0;
#endif
}
