// The data of a mechanism: bodies on joints, and the closures between them.
#pragma once

#include <array>

#include "math/vec3.hpp"
#include "truepose/sizes.hpp"

namespace truepose::engine {
inline constexpr int kBodies = 20, kFreedoms = 24, kClosures = kMaxRods;

enum class Kind : int {
  slide = 0,  ///< along its axis
  shift = 1,  ///< along x, y (and z, with three freedoms) of its parent
  hinge = 2,  ///< about its axis
  ball = 3,   ///< y: its rotation vector, moved by small turns about x, y, z of its parent
};

/// A body and the joint that carries it. With all freedoms at zero, all frames are parallel.
struct Body {
  Kind kind = Kind::hinge;
  int parent = -1;             ///< -1: the base; else a body before this one
  int freedom = 0;             ///< the first of its freedoms; several bodies may share one
  int count = 1;               ///< of its freedoms
  Vec3 origin = Vec3::Zero();  ///< of the joint, in the parent
  Vec3 axis = Vec3::UnitZ();   ///< of a slide or hinge, unit, in the parent
  Real ratio = 1, offset = 0;  ///< a slide or hinge is at offset + ratio y
};

/// A rod |A - B| = L between points of two bodies; or, as a plane, (A - B)·normal = 0.
struct Closure {
  int body_a = -1, body_b = -1;  ///< -1: the base
  Vec3 a = Vec3::Zero(), b = Vec3::Zero();
  Real length = 0;
  int driven = -1;      ///< freedom that adds to the length; -1: none
  int motor = -1;       ///< freedom that moves B by an arm or carriage; -1: none
  int mode = 0;         ///< working mode: sign of the derivative by `motor`; 0: not checked
  Real compliance = 1;  ///< of an elastic mechanism: change of f per tension (L² for equal springs)
  bool plane = false;
  Vec3 normal = Vec3::UnitZ();  ///< of a plane, unit, in the body of B
  int described = 0;       ///< the file's closure of which it is an equation: they share parameters
  bool exchanged = false;  ///< A is the described closure's base, B its anchor
};

/// y = [motors q; platform coordinates x; hidden h]. Only the first of each kind are read.
struct Mechanism {
  int bodies = 0, closures = 0;
  int motors = 0, coordinates = 0, freedoms = 0;
  int sign = 0;  ///< assembly mode: of det ∂f/∂(x, h), as of mode_of; 0: not checked
  /// One closure more than x and h need: all deflect, equally stiff, as little as closes the loops.
  bool elastic = false;
  int platform = -1;  ///< body whose frame is the robot's platform
  int described = 0;  ///< closures of the file, of one to three equations each
  /// y at the robot's home; finish closes the loops there, from these motors and hidden freedoms.
  std::array<Real, kFreedoms> home{};
  std::array<Body, kBodies> body;
  std::array<Closure, kClosures> closure;
};
}  // namespace truepose::engine
