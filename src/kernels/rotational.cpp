// Compiled kernels of rotational platforms.
#include "truepose/kernels.hpp"

namespace truepose {
TRUEPOSE_PIVOT_KERNELS()
}
