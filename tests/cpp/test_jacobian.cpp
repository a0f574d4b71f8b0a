// Jacobians against finite differences, in the tangent space.
#include "derivative.hpp"
#include "mechanism/damping.hpp"
#include "mechanism/rkm.hpp"
#include "reference.hpp"
#include "rotational.hpp"

using namespace pivots_tested;

namespace {

Coordinates unit(int i, double size) {
  Coordinates step{};
  step[i] = size;
  return step;
}

}  // namespace

TEST_EACH(for_each,
          "the rows of J_x and the entries of J_q are derivatives of the closure (|v|² - L²)/2") {
  check::Random random(32);
  for (int k = 0; k < 50; ++k) {
    const Pose pose = any_pose(random);
    Closure closure;
    Jacobians jacobians;
    CHECK(ikm(robot, pose, closure));
    CHECK(jacobian(closure, jacobians));
    for (int i = 0; i < motors; ++i) {
      const Chain& chain = robot.chain[i];
      const auto closed = [&](const Pose& at, double q) {
        const Driven driven = driven_point(chain, q);
        const Vec3 v = chain.base + driven.p - at.D - at.R * chain.pivot - chain.anchor;
        return 0.5 * (v.squaredNorm() - driven.rod * driven.rod);
      };
      const double q = closure.chain[i].q;
      CHECK_NEAR(jacobians.jq[i], derivative([&](double h) { return closed(pose, q + h); }), 1e-10);
      CHECK_NEAR(jacobians.jq[i], jq_entry(chain, closure.chain[i].v, driven_point(chain, q)),
                 1e-14);
      for (int j = 0; j < n; ++j)  // the closure falls along v when A moves towards B
        CHECK_NEAR(jacobians.jx[i][j],
                   -derivative([&](double h) { return closed(moved(K, pose, unit(j, h)), q); }),
                   1e-10);
    }
  }
}

TEST_EACH(for_every,
          "K is the derivative of the inverse model, joint_rate() applies it, and J K = 1") {
  check::Random random(33);
  for (int k = 0; k < 50; ++k) {
    const Pose pose = to_pose(K, any_x(random, reach(K)));
    Closure closure;
    Jacobians jacobians;
    CHECK(ikm(robot, pose, closure));
    CHECK(jacobian(closure, jacobians));
    for (int j = 0; j < n; ++j) {
      const Joint rate = jacobians.joint_rate(unit(j, 1));
      for (int i = 0; i < motors; ++i) {
        const double slope = derivative([&](double h) {
          Closure there;
          CHECK(ikm(robot, moved(K, pose, unit(j, h)), there));
          return there.chain[i].q;
        });
        CHECK_NEAR(rate[i], slope, 1e-8 * (1 + std::fabs(slope)));
      }
      const Coordinates back = pose_rate(jacobians, rate);  // J K
      for (int i = 0; i < n; ++i) CHECK_NEAR(back[i], i == j, 1e-11);
    }
  }
}

TEST_EACH(for_every, "J K J = J, and K J is symmetric: J is the pseudo-inverse of K") {
  check::Random random(36);
  for (int k = 0; k < 20; ++k) {
    Closure closure;
    Jacobians jacobians;
    CHECK(ikm(robot, to_pose(K, any_x(random, reach(K))), closure));
    CHECK(jacobian(closure, jacobians));
    reference::Dense J(n, motors), inverse(motors, n);
    for (int j = 0; j < n; ++j) {
      const Joint rate = jacobians.joint_rate(unit(j, 1));
      for (int i = 0; i < motors; ++i) {
        J(j, i) = jacobians.J[j][i];
        inverse(i, j) = rate[i];
      }
    }
    CHECK((J * inverse * J - J).norm() < 1e-11 * J.norm());
    CHECK((inverse * J - (inverse * J).transpose()).norm() < 1e-10);
  }
}

TEST("the paper's J_q(2,2) has the sign of u_2 = -u_y, not of u_y as printed") {
  Closure closure;
  const Robot robot = h4().robot;
  CHECK(ikm(robot, to_pose(Mobility::schoenflies, robot.home), closure));
  const ChainState& second = closure.chain[1];
  const double paper = second.p.cross(second.v).dot(Vec3::UnitY());  // as printed
  CHECK_NEAR(second.jq, -paper, 1e-15);
  const double slope = derivative([&](double h) {
    return 0.5 * (second.v + driven_point(robot.chain[1], second.q + h).p - second.p).squaredNorm();
  });
  CHECK_NEAR(second.jq, slope, 1e-10);
}

TEST("the sign of a determinant agrees with elimination, and zero is zero") {
  check::Random random(35);
  for (const int n : {2, 3, 4, 6, 8}) {
    Square A;
    int positive = 0;
    for (int k = 0; k < 500; ++k) {
      for (auto& row : A)
        for (double& entry : row) entry = random();
      reference::Dense dense(n, n);
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) dense(i, j) = A[i][j];
      CHECK(determinant_sign(n, A) * reference::determinant(dense) > 0);
      positive += determinant_sign(n, A) > 0;
    }
    CHECK(positive > 100 && positive < 400);
    A[n - 1].fill(0);
    CHECK(determinant_sign(n, A) == 0);
  }
  for_each([&](const Mechanism& mechanism) {
    const Mobility K = mechanism.robot.mobility;
    for (int k = 0; k < 50; ++k) {
      Closure closure;
      Jacobians jacobians;
      CHECK(ikm(mechanism.robot, to_pose(K, random_pose(mechanism, random)), closure));
      CHECK(jacobian(closure, jacobians));
      const bool square = mechanism.robot.motors == dof(K);
      CHECK(jacobians.sign == (square ? determinant_sign(dof(K), jacobians.jx) : 0));
      CHECK(Conditioning(closure).sign() == jacobians.sign);
    }
  });
}

TEST("a matrix that loses rank is not regular, of any size") {
  check::Random random(61);
  for (int n = 2; n <= kMaxUnknowns; ++n) {
    Square a{}, inverse;
    Unknowns size{};
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) {
        a[i][j] = i < n - 1 ? random() : a[0][j] - 2 * a[n - 2][j];
        size[j] += 5 * a[i][j] * a[i][j];
      }
    CHECK(!invert(n, n, a, size, inverse));
    a[n - 1][0] += 1;
    CHECK(invert(n, n, a, size, inverse));
  }
}
