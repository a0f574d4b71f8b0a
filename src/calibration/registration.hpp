// Registration of an external measurement: frame of the tracker and place of the marker.
//
// The tracker measures the marker's frame in its own frame: T ∘ (D, R) ∘ (c, M), that is
//
//   p = t + R_F (D + R c),  Q = R_F R M.
//
// T = (t, R_F) and (c, M) are unknowns of a calibration. Their start is Horn's and Kabsch's closed
// form: the rotation that best takes one cloud of points to another, from any rotation.
//
// For rotational platforms the angles of the axes are measured, without a frame.
#pragma once

#include <vector>

#include "math/eliminate.hpp"

namespace truepose {
/// Position and orientation of one frame in another.
struct Frame {
  Vec3 t = Vec3::Zero();
  Mat3 R = Mat3::Identity();
};

/// The base in the tracker's frame, the marker in the platform's. Both the identity: the tracker
/// measures the platform's coordinates in the base frame.
struct Registration {
  Frame base, marker;
};

/// Number of unknowns: shift (m), turn (rad) of base in tracker frame, of marker in platform frame.
inline constexpr int kRegistration = 12;

Registration moved(const Registration& from, const double* step);

/// Expected measured coordinates at a pose, and their derivatives.
struct Seen {
  Vec3 p;
  Mat3 Q;
  PoseMatrix H_x;                    ///< by the pose's twist
  Matrix<kMaxDof, kRegistration> H;  ///< by the registration
  double blunt = 1;                  ///< error of θ relative to that of the marker's turn
};

/// θ is the angle of the marker's x axis about the tracker's z, less certain the nearer the two
/// are. Rotations differ by a rotation vector in the tracker's frame.
Seen seen(Mobility mobility, const Registration& by, const Pose& pose);

/// Measured minus expected coordinates; NaN where nothing was measured.
Coordinates innovation(Mobility mobility, const Seen& expected, const double* measured);

/// Converts θ's residual and derivatives to turns of the marker: times the sine of the angle
/// between its x axis and the tracker's z, which also changes.
void in_turns(Mobility mobility, const Registration& by, const Pose& pose, Seen& expected,
              Coordinates& apart);

/// The middle one of values, the upper one of two.
double median(std::vector<double> values);

/// The nearest rotation to a matrix: R of the largest tr(RᵀA), det R = 1.
Mat3 nearest_rotation(const Mat3& A);

/// Computes an initial registration from roughly known poses; measurements may contain gross errors
/// (each is weighted by its distance). Alternates two linear steps: the base given the marker's
/// position, and that position given the base's rotation. Needs full positions on lines that span a
/// plane; otherwise tracker and base are assumed parallel.
/// @param known     assumed place of the marker; base where it is known
/// @param moved     whether the base is unknown
/// @param movable   whether the marker's position is unknown
/// @param turning   whether its orientation is unknown
/// @param pose      of `count` rows; those with a status other than ok are excluded
/// @param measured  count × n coordinates, NaN where missing
Registration registered(Mobility mobility, const Registration& known, bool moved, bool movable,
                        bool turning, int count, const Pose* pose, const Status* status,
                        const double* measured);
}  // namespace truepose
