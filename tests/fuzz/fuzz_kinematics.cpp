// Fuzz target of the ideal level.
#include "control/command.hpp"
#include "control/law.hpp"
#include "decode.hpp"
#include "estimation/linearise.hpp"
#include "mechanism/fkm.hpp"

namespace {

using namespace fuzz;

/// The motors of a pose that the forward model found are those it was given; with more motors than
/// freedoms, no pose nearby has closer ones.
void check_forward(const Robot& robot, const Joint& q, const Coordinates& x) {
  const Mobility K = robot.mobility;
  const Pose pose = to_pose(K, x);
  Closure closure;
  const Outcome outcome = ikm(robot, pose, closure);
  Carried carried;
  carry(robot, pose, carried);
  Coordinates slope{};  // of the squares of the readings' deviations
  double steepest = 0, largest = 1;
  for (int i = 0; i < robot.motors; ++i) {
    const Chain& chain = robot.chain[i];
    const Driven driven = driven_point(chain, q[i]);
    const Vec3 lever = pose.R * chain.pivot;
    const Vec3 v = chain.base + driven.p - pose.D - lever - chain.anchor;
    const double size = chain.base.norm() + driven.p.norm() + pose.D.norm() + lever.norm() +
                        chain.anchor.norm() + driven.rod;
    const double open = std::fabs(v.norm() - driven.rod);
    if (overdriven(robot)) {
      largest = std::max(largest, size);
      require(open < kDisagreement * size, "a pose that fkm found fits its readings");
      const double jq = jq_entry(chain, v, driven);
      Real row[kMaxDof];
      jx_row(carried, v, lever, row);
      for (int j = 0; j < dof(K); ++j) {
        slope[j] += row[j] / jq * (0.5 * (v.squaredNorm() - driven.rod * driven.rod) / jq);
        steepest += std::pow(row[j] / jq, 2);
      }
      continue;
    }
    require(open < 1e-11 * size, "a pose that fkm found is closed");
    if (!outcome) continue;
    // B, not q, whose turns are free. Where an arm is stretched it is a root of the closure error.
    const double off = chain.actuator == Actuator::telescopic
                           ? std::fabs(closure.chain[i].q - q[i])
                           : (closure.chain[i].p - driven.p).norm();
    const double jq = jq_entry(chain, v, driven) / driven.dB.norm();
    require(off < 1e-5 * size || std::fabs(off * jq) < 1e-9 * size * size, "ikm undoes fkm");
  }
  for (int j = 0; j < dof(K) && overdriven(robot); ++j)
    require(std::fabs(slope[j]) <= 1e-8 * steepest * largest,
            "a pose nearby fits the readings better");
  // Only where an arm is stretched a rounding may put a pose out of reach.
  require(outcome || outcome.status == Status::unreachable, "a pose that fkm found is a pose");
}

void check_pose(const Robot& robot, const Coordinates& x, double band) {
  const Mobility K = robot.mobility;
  const int n = dof(K), m = robot.motors, rows = readings(robot);
  Joint q{};
  if (ikm(Level::ideal, robot, x, q)) require(all_finite(q, m), "ikm: ok is finite");
  if (command(Level::ideal, robot, x, q)) require(all_finite(q, m), "command: ok is finite");
  JointMatrix J;
  if (jacobian(Level::ideal, robot, x, J)) require(finite(J, n, m), "jacobian: ok is finite");
  ExtendedColumns M;
  ExtendedRows M_plus;
  if (tej(robot, x, M, M_plus, band)) {
    require(finite(M, rows, m), "tej: M is finite");
    require(finite(M_plus, m, rows), "tej: M⁺ is finite");
  }
  double parallel = 0;
  Joint serial{};
  if (conditioning(robot, x, parallel, serial))
    require(parallel >= 0 && parallel < 1 + 1e-9 && all_finite(serial, m),
            "conditioning: ok is from 0 to 1");
  Closure closure;
  Jacobians jacobians;
  Reading values;
  SensorRows jr;
  if (!ikm(robot, to_pose(K, x), closure) || !jacobian(closure, jacobians) ||
      !rkm(robot, closure, values, jr))
    return;
  require(all_finite(values, robot.r), "rkm: ok is finite");
  require(finite(jr, robot.r, n), "rkm: J_r is finite");
  std::vector<double> H_xi(rows * parameter_count(robot));
  Extended q_e;
  PoseRows H_x;
  if (!linearise(Level::ideal, robot, to_pose(K, x), q_e, H_x, H_xi.data())) return;
  require(all_finite(q_e, rows) && finite(H_x, rows, n), "linearise: H_x is finite");
  require(all_finite(H_xi, static_cast<int>(H_xi.size())), "linearise: H_ξ is finite");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes bytes(data, size);
  const Subject subject = decode_robot(bytes);
  const Robot& robot = subject.robot;
  const Coordinates x = decode_pose(bytes, subject);
  const Joint q = decode_motors(bytes, subject);
  Coordinates found = decode_pose(bytes, subject);
  const double band = bytes.one_in(2) ? std::fabs(bytes.share()) : 0;
  Extended q_e{};
  for (int k = 0; k < robot.r; ++k) q_e[robot.motors + k] = bytes.number();
  std::copy_n(q.begin(), robot.motors, q_e.begin());
  check_pose(robot, x, band);
  const FkmResult result = fkm(Level::ideal, robot, q, found);
  require(result.iterations <= 2 * kFkmIterations, "fkm: iterations are bounded");
  if (result) {
    require(all_finite(found, dof(robot.mobility)), "fkm: ok is finite");
    if (subject.buildable) check_forward(robot, q, found);
  }
  Coordinates estimate{};
  if (redundant_fkm(robot, q_e, estimate))
    require(all_finite(estimate, dof(robot.mobility)), "redundant fkm: ok is finite");
  return 0;
}
