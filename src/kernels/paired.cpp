// Compiled kernels of mobilities with paired rods, at both levels.
#include "truepose/kernels.hpp"

namespace truepose {
TRUEPOSE_PAIRED_KERNELS()
}
