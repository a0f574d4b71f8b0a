// Compiled kernels of mobilities with one rod per chain.
#include "truepose/kernels.hpp"

namespace truepose {
TRUEPOSE_PLANE_AND_SPACE_KERNELS()
}
