// The native library's interface: plain C, arrays row by row, doubles and 64-bit integers.
//
// Every function has a counterpart in numpy, which is what it is tested against; sizes are not
// checked here but by those who call.
#pragma once

#include <cstdint>

#define TUBEPLANNER_API extern "C" __attribute__((visibility("default")))

typedef int64_t integer;
