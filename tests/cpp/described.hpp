// Mechanisms of the tests that are described by bodies and closures, and robots of them.
#pragma once

#include "mechanism/full.hpp"
#include "mechanisms.hpp"

namespace mechanisms_described {

using namespace mechanisms;

/// A mechanism and a box about its home.
struct Described {
  const char* name;
  engine::Mechanism mechanism;
  engine::Row home{}, box{};  ///< of x
};

/// 3-RPS, 3-PRS, planar 4-RRR (one motor more than freedoms), and two platforms on balls.
std::vector<Described> described();

/// A statement about each robot of three coordinates, with every sensor that it can carry.
void for_each_described(const std::function<void(const Mechanism&)>& f);

}  // namespace mechanisms_described
