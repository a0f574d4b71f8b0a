// The kernels of pivots, compiled.
#include "truepose/kernels.hpp"

namespace truepose {
TRUEPOSE_PIVOT_KERNELS()
}
