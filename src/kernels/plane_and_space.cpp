// The kernels of mobilities whose chains have one rod each, compiled.
#include "truepose/kernels.hpp"

namespace truepose {
TRUEPOSE_PLANE_AND_SPACE_KERNELS()
}
