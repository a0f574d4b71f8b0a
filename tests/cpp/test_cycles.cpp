// Control cycles of robots at work: bounded steps, and searches for x̂ that go on in the next cycle.
#include "at_work.hpp"
#include "controllers.hpp"

using namespace mechanisms;

namespace {

/// Calls f(robot at work) for every mechanism whose rods hold the platform, at both levels.
template <class F>
void for_each_at_work(F&& f) {
  for_all(every_rod(), [&](const Mechanism& mechanism) {
    for (const Level level : {Level::ideal, Level::full})
      for (const int sensors : {1, 6}) {
        AtWork at(mechanism, level, sensors);
        f(at);
      }
  });
}

/// The last cycle's search for x̂: its state, and the steps that the cycle has taken.
const PoseSearch& search_of(const ControlState& state) { return state.nearby.search; }
int steps_of(const ControlState& state) { return kCycleSteps - search_of(state).left; }

}  // namespace

TEST("no input makes a cycle take more steps than it may") {
  for_each_at_work([](AtWork& at) {
    const auto motion = at.motion(20), trouble = at.trouble(210);
    for (const Law law : {Law::cartesian, Law::weighted, Law::estimated})
      for (const bool caches : {false, true}) {
        const ControlSettings settings = settings_for(at.robot, law);
        ControlState state;
        CachedGain kept;
        Weighing weighing = at.prior.weighing();
        if (caches) weighing.kept = &kept;
        const auto cycle = [&](const AtWork::Cycle& of) {
          const bool answered =
              bool(control(at.robot, settings, of.setpoint, of.q_e, state, weighing));
          CHECK(search_of(state).left >= 0 && state.nearby.left >= 0);
          return answered;
        };
        for (std::size_t k = 0; k < motion.size(); ++k) {
          CHECK(cycle(motion[k]));
          CHECK(steps_of(state) <= 16 || law != Law::estimated);
        }
        for (const AtWork::Cycle& wrong : trouble) {
          for (int again = 0; again < 2; ++again) static_cast<void>(cycle(wrong));
          for (int again = 0; again < 5 && !cycle(motion[0]); ++again) CHECK(again < 4);
        }
      }
  });
}

TEST("a search that has no steps left goes on, and finds what one without a limit finds") {
  int went_on = 0;
  for_each_at_work([&](AtWork& at) {
    const Robot& robot = at.robot;
    const ControlSettings settings = settings_for(robot, Law::estimated);
    const Weighing weighing = at.prior.weighing();
    const auto trouble = at.trouble(350);
    for (std::size_t k = 0; k < trouble.size(); ++k) {
      if (k % 7 > 3) continue;  // readings of no pose: the last steps are large (kFlat)
      const AtWork::Cycle& of = trouble[k];
      Reference reference;
      Joint error{};
      Pose found;
      const bool ends =
          refer(robot, Law::estimated, of.setpoint.x, reference, 0, weighing) &&
          motor_error(robot, Law::estimated, reference, of.q_e, error, found, weighing);
      ControlState state;
      int cycles = 0;
      const auto answers = [&] {
        return bool(control(robot, settings, of.setpoint, of.q_e, state, weighing));
      };
      while (cycles < kSearchCycles && answers() && search_of(state).steps >= 0) ++cycles;
      if (!ends || cycles == kSearchCycles || !search_of(state).known) continue;
      went_on += cycles > 0;
      for (int again = 0; again < 4; ++again) CHECK(answers());
      // Within 0.01 σ, or of the residual that remains where that is larger (is_last).
      ReadingCovariance C;
      Expected there{found, {}, {}};
      Fusion fusion;
      Parasitic rest;
      CHECK(refer(robot, Law::estimated, of.setpoint.x, reference, 0, weighing));
      CHECK(reading_covariance(robot, *weighing.known, weighing.work,
                               weighing.work + readings(robot) * parameter_count(robot), C));
      CHECK(linearise(level_of(robot), robot, found, there.q_e, there.H_x, nullptr, &rest));
      CHECK(fuse(robot, *weighing.known, C, there.H_x, fusion));
      Extended white;
      const Real residual = chi2(robot, *weighing.known, C, of.q_e, there.q_e, white);
      const Real most = 0.01 * std::sqrt(std::max(1.0, residual / readings(robot)));
      const Pose answered = moved(robot.mobility, reference.closure.pose, search_of(state).good);
      const Coordinates apart = difference(robot.mobility, answered, found);
      for (int i = 0; i < dof(robot.mobility); ++i)
        CHECK_NEAR(apart[i], 0, most * std::sqrt(fusion.covariance[i][i]));
    }
  });
  CHECK(went_on > 100);
}

TEST("meanwhile a law answers from the last pose, which moves along with the setpoint") {
  for_each_at_work([](AtWork& at) {
    const Robot& robot = at.robot;
    const ControlSettings settings = settings_for(robot, Law::estimated);
    const Weighing weighing = at.prior.weighing();
    const auto motion = at.motion(20), trouble = at.trouble(350);
    for (const AtWork::Cycle& wrong : trouble) {
      ControlState state;
      for (const AtWork::Cycle& usual : motion)
        CHECK(control(robot, settings, usual.setpoint, usual.q_e, state, weighing));
      const Coordinates before = search_of(state).good;
      for (int cycles = 1; cycles <= kSearchCycles; ++cycles) {
        const Outcome answer =
            control(robot, settings, motion.back().setpoint, wrong.q_e, state, weighing);
        if (search_of(state).steps < 0) break;
        CHECK(answer && cycles < kSearchCycles);
        for (int i = 0; i < dof(robot.mobility); ++i) CHECK(search_of(state).good[i] == before[i]);
      }
    }
  });
}

TEST("readings without a pose have no answer again once a search for it has failed") {
  int without = 0;
  for_each_at_work([&](AtWork& at) {
    const ControlSettings settings = settings_for(at.robot, Law::estimated);
    const auto motion = at.motion(20), trouble = at.trouble(105);
    for (const AtWork::Cycle& wrong : trouble)
      for (const bool caches : {false, true}) {
        ControlState state;
        CachedGain kept;
        Weighing weighing = at.prior.weighing();
        const Setpoint& setpoint = motion.back().setpoint;
        Reference reference;
        Joint error{};
        Pose found;
        CHECK(refer(at.robot, Law::estimated, setpoint.x, reference, 0, weighing));
        if (motor_error(at.robot, Law::estimated, reference, wrong.q_e, error, found, weighing))
          continue;
        if (caches) weighing.kept = &kept;
        for (const AtWork::Cycle& usual : motion)
          CHECK(control(at.robot, settings, usual.setpoint, usual.q_e, state, weighing));
        bool failed = false;
        for (int cycle = 0; cycle < 50; ++cycle) {
          const bool answers =
              bool(control(at.robot, settings, setpoint, wrong.q_e, state, weighing));
          CHECK(!failed || !answers);
          failed = failed || !answers;
        }
        without += failed;
      }
  });
  CHECK(without > 100);
}

TEST("the law's x̂ solves its own least squares") {
  for_each_at_work([](AtWork& at) {
    const Robot& robot = at.robot;
    const Weighing weighing = at.prior.weighing();
    Parasitic nearby;
    for (const AtWork::Cycle& of : at.motion(20)) {
      Reference reference;
      Joint error{};
      ReadingCovariance C;
      Expected there;
      CHECK(refer(robot, Law::estimated, of.setpoint.x, reference, 0, weighing, &nearby));
      CHECK(motor_error(robot, Law::estimated, reference, of.q_e, error, there.pose, weighing));
      const Real* H_xi = weighing.work;
      Real* B = weighing.work + readings(robot) * parameter_count(robot);
      CHECK(reading_covariance(robot, *weighing.known, H_xi, B, C));
      const Pose found = there.pose;
      CHECK(linearise(level_of(robot), robot, found, there.q_e, there.H_x, nullptr, &nearby));
      CHECK(search(level_of(robot), robot, *weighing.known, C, of.q_e, there, nearby, 0, 1));
      CHECK_NEAR(distance(robot.mobility, found, there.pose), 0, 1e-8);
    }
  });
}
