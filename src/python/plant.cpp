// The core's services for an external plant: readings, setpoints, reference motion. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

#include "control/trajectory.hpp"
#include "mechanism/angles_of.hpp"
#include "mechanism/full.hpp"
#include "python/arrays.hpp"
#include "python/for_rows.hpp"
#include "python/vectors.hpp"
#include "simulation/plant.hpp"

namespace truepose::python {
namespace {
/// Exact readings of a mechanism at this pose with these motors and arms.
auto readings(const Robot& robot, const Vec3& D, const Mat3& R,
              const std::array<double, kMaxBars>& psi, double theta, const Joint& motor,
              const Joint& arm) {
  FullPose pose;
  pose.D = D, pose.R = R, pose.psi = psi, pose.theta = theta;
  Extended q_e{};
  const Outcome outcome = read_standing(robot, pose, motor, arm, q_e);
  return nb::make_tuple(q_e, static_cast<int>(outcome.status));
}

/// Row i of an array as a vector, or as a rotation by rows.
Vec3 vector(const Rows& rows, std::size_t i) { return row<Vec3>(rows, i); }
Mat3 rotation(const Rows& rows, std::size_t i) { return row<Mat3>(rows, i).transpose(); }

/// R, (N, 3, 3), of rotation vectors, (N, 3).
auto rotations(const Rows& vectors) {
  Owned<double> R({vectors.shape(0), 3, 3});
  for_rows(vectors.shape(0), [&](std::size_t i) {
    const Mat3 columns = exp_so3(vector(vectors, i)).transpose();
    std::copy_n(columns.data(), 9, R[i]);
  });
  return R.release();
}

/// The inverse, (N, 3) of rows of nine entries.
auto rotation_vectors(const Rows& R) {
  Owned<double> vectors({R.shape(0), 3});
  for_rows(R.shape(0), [&](std::size_t i) {
    const Vec3 w = log_so3(rotation(R, i));
    std::copy_n(w.data(), 3, vectors[i]);
  });
  return vectors.release();
}

/// Frames of the platform, (N, 4, 4). @param tilt  rotation not in x, (N, 3); with a θ, about x, y
auto frames(const Robot& robot, const Rows& x, const Rows& tilt) {
  Owned<double> all({x.shape(0), 4, 4});
  for_rows(x.shape(0), [&](std::size_t i) {
    const Pose pose = placed(robot, to_pose(robot.mobility, row<Coordinates>(x, i)));
    Vec3 turn = vector(tilt, i);
    if (turns_about_z(robot.mobility)) turn = tilt_keeping(pose.theta, turn.x(), turn.y());
    const Mat3 R = exp_so3(turn) * pose.R;
    for (int k = 0; k < 16; ++k) {
      const int line = k / 4, column = k % 4;
      all[i][k] = line == 3 ? column == 3 : column == 3 ? pose.D[line] : R(line, column);
    }
  });
  return all.release();
}

/// Coordinates, (N, n), of positions, (N, 3), and orientations, (N, 9); axis angles from home's.
auto coordinates(const Robot& robot, const Rows& D, const Rows& R) {
  const std::size_t n = dof(robot.mobility);
  Owned<double> x({D.shape(0), n});
  for_rows(D.shape(0), [&](std::size_t i) {
    Pose pose{vector(D, i), rotation(R, i), 0};
    pose.theta = theta_of(pose.R, 0);
    if (is_rotational(robot.mobility)) {
      Pose angles = to_pose(robot.mobility, robot.home);
      angles_of(robot, pose, angles);
      pose = angles;
    }
    std::copy_n(to_coordinates(robot.mobility, pose).begin(), n, x[i]);
  });
  return x.release();
}

/// Setpoint at a time of a straight quintic move.
auto setpoint(const Robot& robot, const Coordinates& from, const Coordinates& to, double duration,
              double time) {
  const Setpoint at = quintic(robot.mobility, from, to, duration, time);
  return nb::make_tuple(at.x, at.rate, at.acceleration);
}

/// M(x), (N, n, n), of the reduced model.
auto batch_mass_matrix(const Robot& robot, const Rows& x) {
  const std::size_t n = x.shape(1);
  return batch(x.shape(0), {{n, n}}, [&](std::size_t i, auto& out) {
    PoseMatrix mass;
    const Outcome outcome =
        mass_matrix(robot, to_pose(robot.mobility, row<Coordinates>(x, i)), mass);
    write(mass, n, n, out[0]);
    return outcome;
  });
}

/// Torques of a motion, and motion under torques, for poses, twists and their derivatives, (N, n).
auto batch_inverse_dynamics(const Robot& robot, const Rows& x, const Rows& rate,
                            const Rows& acceleration) {
  return map_rows<Coordinates, Joint>(
      x, x.shape(1), [&](const Coordinates& at, Joint& torque, std::size_t i) {
        return inverse_dynamics(robot, to_pose(robot.mobility, at), row<Coordinates>(rate, i),
                                row<Coordinates>(acceleration, i), torque);
      });
}
auto batch_acceleration(const Robot& robot, const Rows& x, const Rows& rate, const Rows& torque) {
  return map_rows<Coordinates, Coordinates>(
      x, x.shape(1), [&](const Coordinates& at, Coordinates& acceleration, std::size_t i) {
        return forward_dynamics(robot, to_pose(robot.mobility, at), row<Coordinates>(rate, i),
                                row<Joint>(torque, i), acceleration);
      });
}

/// State of the reduced model after a time under constant torques: pose and free twist.
auto advance_free(const Robot& robot, const Coordinates& x, const Coordinates& rate,
                  const Joint& torque, double duration, int steps) {
  Coordinates end{}, end_rate{};
  PlantState state{to_pose(robot.mobility, x), rate};
  const Outcome outcome = advance(robot, torque, duration, steps, state);
  end = to_coordinates(robot.mobility, state.pose);
  end_rate = state.rate;
  return nb::make_tuple(end, end_rate, static_cast<int>(outcome.status));
}
}  // namespace

void bind_plant(nb::module_& m) {
  m.def("readings", &readings);
  m.def("rotations", &rotations);
  m.def("rotation_vectors", &rotation_vectors);
  m.def("frames", &frames);
  m.def("coordinates", &coordinates);
  m.def("setpoint", &setpoint);
  m.def("mass_matrix", &batch_mass_matrix);
  m.def("inverse_dynamics", &batch_inverse_dynamics);
  m.def("acceleration", &batch_acceleration);
  m.def("advance", &advance_free);
}
}  // namespace truepose::python
