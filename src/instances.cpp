// The templates of instances.hpp, compiled.
#include "instances.hpp"

namespace truepose {
TRUEPOSE_INSTANCES()
}
