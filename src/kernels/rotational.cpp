// Compiled kernels of rotational platforms.
#include "truepose/kernels.hpp"

namespace truepose {
TRUEPOSE_ROTATIONAL_KERNELS()
}
