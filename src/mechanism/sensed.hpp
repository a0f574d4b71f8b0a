// Value and gradients of one sensor, of any kind.
#pragma once

#include "mechanism/ikm.hpp"

namespace truepose {
/// s and its derivatives, without gain and offset; zero for what a kind does not depend on.
struct Sensed {
  Real value = 0;
  Real angle = 0;               ///< of an encoder: the measured angle, `value` being the reading
  Real slope = 1;               ///< ∂value/∂angle
  Vec3 linear = Vec3::Zero();   ///< ∂s/∂D, the whole platform moving with it
  Vec3 angular = Vec3::Zero();  ///< ∂s/∂(small rotation of the platform), base frame
  Vec3 rod = Vec3::Zero();      ///< ∂s/∂(A - B) of its chain
  Vec3 frame = Vec3::Zero();    ///< ∂s/∂(small rotation of the rod's reference frame), base frame
  Vec3 origin = Vec3::Zero(), direction = Vec3::Zero();  ///< ∂s/∂ of the mounting
  Vec3 target = Vec3::Zero(), normal = Vec3::Zero();
};

/// A rod for a sensor on it, base frame.
struct SeenChain {
  Vec3 rod;            ///< B to A
  Vec3 forward, axis;  ///< of the frame of its joint
  Mat3 body;           ///< orientation of the body that carries the joint
  bool mounted;        ///< whether the frame is the sensor's own mounting, fixed in that body
};
}  // namespace truepose
