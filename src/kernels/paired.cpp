// The kernels of mobilities whose rods come in pairs, at both levels, compiled.
#include "truepose/kernels.hpp"

namespace truepose {
TRUEPOSE_PAIRED_KERNELS()
}
