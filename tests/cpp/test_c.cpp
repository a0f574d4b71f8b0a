// The C interface, and the C++ one over it, answer as the core does and refuse what is no robot.
#include <cstring>

#include "in_c.hpp"
#include "math/roll_pitch_yaw.hpp"
#include "mechanism/gyro.hpp"
#include "rotational.hpp"

using namespace pivots_tested;

namespace {

constexpr int kCap = 12;

/// f(robot) at the ideal level, and at the full one where there is one.
template <class F>
void at_each_level(const Robot& robot, F&& f) {
  f(robot);
  if (!robot.full.own()) return;
  Robot by_rods = robot;
  by_rods.level = Level::full;
  f(by_rods);
}

}  // namespace

TEST_EACH(for_each, "kinematics through C is the core's, bit for bit, at both levels") {
  check::Random random(1);
  at_each_level(mechanism.robot, [&](const Robot& robot) {
    const ModelInC model(robot);
    CHECK(same(model.outcome, {}));
    CHECK(truepose_freedoms(model) == n && truepose_motors(model) == motors);
    CHECK(truepose_sensors(model) == robot.r);
    const Level level = level_of(robot);
    for (int k = 0; k < 20; ++k) {
      const Coordinates x = any_x(random);
      Joint q{};
      truepose_real q_c[TRUEPOSE_MOTORS] = {}, x_c[TRUEPOSE_FREEDOMS] = {},
                    q_e[TRUEPOSE_READINGS] = {};
      CHECK(same(truepose_ikm(model, x.data(), q_c), command(level, robot, x, q)));
      CHECK(same(q_c, q));
      Coordinates found = robot.home;
      std::copy_n(robot.home.begin(), 6, x_c);
      const truepose_fkm_result result = truepose_fkm(model, q_c, kCap, x_c);
      CHECK(result.outcome.status == TRUEPOSE_OK);
      CHECK(fkm(level, robot, q, found).status == Status::ok);
      CHECK(same(x_c, found));
      Extended read{};
      CHECK(same(truepose_readings(model, x.data(), q_e),
                 extended(level, robot, to_pose(robot.mobility, x), read)));
      CHECK(same(q_e, read));
      for (int i = 0; i < robot.motors; ++i) CHECK_NEAR(q_e[i], q[i], 1e-12);
      JointMatrix J{};
      truepose_real J_c[TRUEPOSE_FREEDOMS * TRUEPOSE_MOTORS] = {};
      CHECK(same(truepose_jacobian(model, x.data(), J_c), jacobian(level, robot, x, J)));
      CHECK(std::memcmp(J_c, &J, sizeof J) == 0);
      double parallel = 0;
      Joint serial{};
      truepose_real parallel_c = 0, serial_c[TRUEPOSE_MOTORS] = {};
      CHECK(same(truepose_conditioning(model, x.data(), &parallel_c, serial_c),
                 conditioning(robot, x, parallel, serial)));
      CHECK(parallel_c == parallel && same(serial_c, serial));
      ExtendedColumns M{};
      ExtendedRows M_plus{};
      truepose_real tej_c[TRUEPOSE_MOTORS * TRUEPOSE_READINGS] = {};
      CHECK(same(truepose_tej(model, x.data(), 0, tej_c), tej(robot, x, M, M_plus)));
      for (int i = 0; i < robot.motors; ++i)
        CHECK(std::equal(tej_c + kMaxReadings * i,
                         tej_c + kMaxReadings * i + robot.motors + robot.r, M_plus[i].begin()));
    }
  });
}

TEST_EACH(for_each, "a pose as position and rotation is the same pose") {
  check::Random random(2);
  const ModelInC model(robot);
  for (int k = 0; k < 20; ++k) {
    const Coordinates x = any_x(random);
    truepose_pose pose, found;
    truepose_real back[TRUEPOSE_FREEDOMS], q[TRUEPOSE_MOTORS], q_pose[TRUEPOSE_MOTORS];
    std::copy_n(x.begin(), 6, back);
    CHECK(same(truepose_pose_of(model, x.data(), &pose), {}));
    CHECK(same(truepose_coordinates_of(model, &pose, back), {}));
    for (int i = 0; i < 6; ++i) CHECK_NEAR(back[i], x[i], 1e-14);
    CHECK(same(truepose_ikm(model, x.data(), q), {}));
    Real least = 0, parallel = 0;
    Joint serial{};
    CHECK(same(truepose_ikm_pose(model, &pose, q_pose, &least), {}));
    for (int i = 0; i < motors; ++i) CHECK_NEAR(q_pose[i], q[i], 1e-12);
    CHECK(conditioning(robot, x, parallel, serial));
    for (int i = 0; i < motors; ++i) parallel = std::min(parallel, serial[i]);
    CHECK_NEAR(least, parallel, 1e-10);
    truepose_pose_of(model, robot.home.data(), &found);
    CHECK(truepose_fkm_pose(model, q, kCap, &found).outcome.status == TRUEPOSE_OK);
    for (int i = 0; i < 9; ++i) CHECK_NEAR(found.rotation[i], pose.rotation[i], 1e-10);
  }
  truepose_pose flat = {{0, 0, -0.4}, {1, 0, 0, 0, 1, 0, 0, 0, 1.1}};
  truepose_real x[TRUEPOSE_FREEDOMS] = {};
  CHECK(truepose_coordinates_of(model, &flat, x).status == TRUEPOSE_NO_SUCH_VALUE);
  flat.rotation[8] = NAN;
  CHECK(truepose_coordinates_of(model, &flat, x).status == TRUEPOSE_NOT_FINITE);
  if (robot.mobility == Mobility::spatial) return;
  const truepose_pose tilted = {{0, 0, -0.4}, {1, 0, 0, 0, 0.8, -0.6, 0, 0.6, 0.8}};
  CHECK(truepose_coordinates_of(model, &tilted, x).status == TRUEPOSE_NO_SUCH_VALUE);
}

TEST_EACH(for_each_pivot,
          "a pivot through C is the core's: angles, places, torques, and axes that are none are "
          "refused") {
  Robot robot = mechanism.robot;
  for (int j = 0; j < n; ++j) robot.axis[j].low = -2, robot.axis[j].high = 2;
  robot.sensor[0] = Sensor{};
  robot.sensor[0].kind = SensorKind::axis_angle;
  robot.sensor[0].axis = n - 1;
  CHECK(finish(robot));
  const ModelInC model(robot);
  CHECK(same(model.outcome, {}));
  truepose_description again;
  CHECK(same(truepose_description_of(model, &again), {}));
  CHECK(std::memcmp(&again, &model.table, sizeof again) == 0);
  check::Random random(9);
  for (int k = 0; k < 20; ++k) {
    const Coordinates x = any_x(random, 0.6);
    Joint q{};
    truepose_real q_c[TRUEPOSE_MOTORS],
        x_c[TRUEPOSE_FREEDOMS] = {}, J[TRUEPOSE_FREEDOMS * TRUEPOSE_MOTORS],
        torque[TRUEPOSE_MOTORS] = {}, joint[TRUEPOSE_FREEDOMS], back[TRUEPOSE_MOTORS],
        read[TRUEPOSE_READINGS];
    CHECK(ikm(Level::ideal, robot, x, q) && same(truepose_ikm(model, x.data(), q_c), {}));
    CHECK(same(q_c, q));
    CHECK(same(truepose_fkm(model, q_c, kCap, x_c).outcome, {}));
    for (int j = 0; j < n; ++j) CHECK_NEAR(x_c[j], x[j], 1e-12);
    CHECK(same(truepose_readings(model, x.data(), read), {}));
    CHECK_NEAR(read[n], x[n - 1], 0);
    truepose_pose pose;
    CHECK(same(truepose_pose_of(model, x.data(), &pose), {}));
    const Pose there = placed(robot, to_pose(K, x));
    for (int i = 0; i < 3; ++i) CHECK_NEAR(pose.position[i], there.D[i], 0);
    truepose_real found[TRUEPOSE_FREEDOMS] = {};
    CHECK(same(truepose_coordinates_of(model, &pose, found), {}));
    for (int j = 0; j < n; ++j) CHECK_NEAR(found[j], x[j], 1e-12);
    pose.position[1] += 0.01;  // its axes cannot carry it there
    CHECK(truepose_coordinates_of(model, &pose, found).status == TRUEPOSE_NO_SUCH_VALUE);
    truepose_real W[18];
    GyroRows rows{};
    CHECK(gyro(robot, x, rows) && same(truepose_gyro(model, x.data(), W), {}));
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < n; ++j) CHECK_NEAR(W[6 * i + j], rows[i][j], 0);
    CHECK(same(truepose_jacobian(model, x.data(), J), {}));
    double at_motors = 0, at_joints = 0;
    for (int i = 0; i < n; ++i) torque[i] = random();
    CHECK(same(truepose_joint_torque(model, x.data(), torque, joint), {}));
    CHECK(same(truepose_motor_torque(model, x.data(), joint, back), {}));
    for (int i = 0; i < n; ++i) {
      CHECK_NEAR(back[i], torque[i], 1e-14);
      at_motors += torque[i] * 0.5 * (i + 1);
      for (int j = 0; j < n; ++j)
        at_joints += joint[j] * J[TRUEPOSE_MOTORS * j + i] * 0.5 * (i + 1);
    }
    CHECK_NEAR(at_motors, at_joints, 1e-14);
  }
  truepose_description table = model.table;
  table.axis[0].direction[0] += 0.1;
  const truepose_outcome bent = ModelInC(table).outcome;
  CHECK(bent.status == TRUEPOSE_NO_SUCH_VALUE && bent.part == kAxisPart);
  table = model.table;
  table.sensor[0].axis = n;
  CHECK(same(ModelInC(table).outcome, {Status::no_such_part, kSensorPart}));
  table = model.table;
  table.axis[n - 1].low = NAN;
  CHECK(ModelInC(table).outcome.status == TRUEPOSE_NOT_FINITE);
}

TEST("roll, pitch and yaw lead to a rotation and back, also upright and over turns") {
  check::Random random(3);
  for (int k = 0; k < 20000; ++k) {
    RollPitchYaw angles{10 * random(), 10 * random(), 10 * random()};
    if (k % 10 == 0) angles[1] = (k % 20 ? 0.5 : -0.5) * std::numbers::pi;
    truepose_real R[9], again[9], near[3];
    CHECK(same(truepose_from_roll_pitch_yaw(angles.data(), R), {}));
    for (int i = 0; i < 3; ++i) near[i] = angles[i] + (i == 0 && k % 10 == 0 ? 0 : 0.01 * random());
    CHECK(same(truepose_to_roll_pitch_yaw(R, near), {}));
    for (int i = 0; i < 3; ++i) CHECK_NEAR(near[i], angles[i], k % 10 == 0 ? 1e-7 : 1e-6);
    CHECK(same(truepose_from_roll_pitch_yaw(near, again), {}));
    for (int i = 0; i < 9; ++i) CHECK_NEAR(again[i], R[i], 1e-9);
  }
  truepose_real angles[3] = {0, NAN, 0}, mirror[9] = {1, 0, 0, 0, 1, 0, 0, 0, -1};
  CHECK(truepose_from_roll_pitch_yaw(angles, mirror).status == TRUEPOSE_NOT_FINITE);
  angles[1] = 0;
  CHECK(truepose_to_roll_pitch_yaw(mirror, angles).status == TRUEPOSE_NO_SUCH_VALUE);
}

TEST_EACH(for_each, "laws, estimates and control cycles through C are the core's") {
  check::Random random(4);
  const ModelInC model(robot);
  KnownInC known(robot);
  CHECK(known.work.size() == truepose_work(model, known.of.count));
  for (const Law law : kLaws) {
    ControlSettings settings;
    settings.law = law;
    settings.sigma_scale = 3;
    CHECK(place_poles(robot, robot.home, 100, 1, settings));
    auto table = in_c(settings);
    CHECK(same(truepose_place_poles(model, robot.home.data(), 100, 1, &table), {}));
    CHECK(same(table.kp, settings.kp) && same(table.kd, settings.kd));
    truepose_controller controller = controller_in_c(table);
    truepose_controller alone = controller_in_c(table);  // of drives that close their own loops
    ControlState state;
    Nearby nearby;
    CachedGain kept, kept_alone;
    Weighing keeps = known.prior.weighing(), keeps_alone = keeps;
    keeps.kept = &kept;
    keeps_alone.kept = &kept_alone;
    for (int k = 0; k < 5; ++k) {
      Setpoint setpoint;
      setpoint.x = any_x(random, 0.3);
      const truepose_setpoint setpoint_c = setpoint_in_c(setpoint.x);
      Extended q_e = readings_at(robot, setpoint.x);
      for (int i = 0; i < motors + robot.r; ++i) q_e[i] += 1e-4 * random();
      ServoCycle e;
      truepose_real torque[TRUEPOSE_MOTORS] = {};
      truepose_servo_cycle cycle;
      CHECK(same(truepose_servo(model, static_cast<int>(law), 0, setpoint.x.data(), q_e.data(),
                                known, known.work.data(), &cycle),
                 servo_cycle(robot, law, setpoint.x, q_e, e, 0, known.prior.weighing())));
      CHECK(same(cycle.error, e.error));
      CHECK(same(truepose_controller_servo(model, &alone, setpoint.x.data(), q_e.data(), known,
                                           known.work.data(), &cycle),
                 servo_cycle(robot, law, setpoint.x, q_e, e, 0, Scaled(keeps_alone, 3).weighing,
                             &nearby)));
      CHECK(same(cycle.error, e.error));
      CHECK(same(truepose_control(model, &controller, &setpoint_c, q_e.data(), known,
                                  known.work.data(), torque),
                 control(robot, settings, setpoint, q_e, state, keeps)));
      CHECK(same(torque, state.torque));
      Pose pose = to_pose(K, robot.home);
      const auto estimated = estimate(Level::ideal, robot, known.of, q_e, pose, known.work.data());
      truepose_real x_c[TRUEPOSE_FREEDOMS];
      std::copy_n(robot.home.begin(), 6, x_c);
      const truepose_estimate_result result =
          truepose_estimate(model, known, q_e.data(), known.work.data(), x_c);
      CHECK(same(result.outcome, estimated.outcome));
      CHECK(same(x_c, to_coordinates(K, pose)) && result.chi2 == estimated.chi2);
    }
  }
  truepose_servo_cycle cycle;
  const truepose_real q_e[TRUEPOSE_READINGS] = {};
  CHECK(truepose_servo(model, TRUEPOSE_LAW_WEIGHTED, 0, robot.home.data(), q_e, nullptr, nullptr,
                       &cycle)
            .status == TRUEPOSE_NOT_MEASURED);
  truepose_controller unfinished{};
  CHECK(truepose_controller_servo(model, &unfinished, robot.home.data(), q_e, nullptr, nullptr,
                                  &cycle)
            .status == TRUEPOSE_UNFINISHED);
  CHECK(truepose_servo(model, 5, 0, robot.home.data(), q_e, nullptr, nullptr, &cycle).status ==
        TRUEPOSE_NO_SUCH_PART);
}

TEST_EACH(for_each,
          "slow sensors in C are the core's, with timestamps and without, under every law") {
  if (robot.r == 0) return;
  ModelInC model(robot);
  KnownInC known(robot);
  MultirateSettings slow;
  slow.every.fill(10);
  slow.age.fill(8);
  slow.sensitivity[0][1] = 0.1;
  for (const Law law : {Law::tej, Law::estimated})
    for (const bool stamped : {false, true})
      for (const bool monitors : {false, true}) {
        slow.stamped = stamped ? 1 : 0;
        const auto slow_c = in_c(slow);
        truepose_multirate sensors;
        Multirate late;
        CHECK(start(slow, late));
        CHECK(same(truepose_multirate_init(&sensors, sizeof sensors, &slow_c), {}));
        ControlSettings settings;
        settings.law = law;
        CHECK(place_poles(robot, robot.home, 60, 1, settings));
        truepose_controller controller = controller_in_c(in_c(settings));
        CHECK(same(truepose_controller_sensors(&controller, &sensors), {}));
        FaultTolerantSettings watch;
        truepose_fault_monitor monitor = monitor_in_c(watch);
        prepare(watch.monitor);
        truepose_fault_report report;
        ControlState state;
        CachedGain kept;
        FaultTolerantState seen;
        Weighing keeps = known.prior.weighing();
        keeps.kept = &kept;
        Extended held{};
        for (int k = 0; k < 60; ++k) {
          Setpoint setpoint;
          setpoint.x = robot.home;
          setpoint.x[0] += 0.02 * std::sin(0.02 * k);
          const truepose_setpoint setpoint_c = setpoint_in_c(setpoint.x);
          Extended q_e = readings_at(robot, setpoint.x);
          const bool comes = k % 10 == 8;
          if (k == 0 || comes) held = q_e;
          std::copy_n(held.begin() + motors, robot.r, q_e.begin() + motors);
          const std::uint64_t now = 1000000 * static_cast<std::uint64_t>(k + 1);
          const std::uint64_t time[kMaxSensors]{now - 7400000};
          const std::uint32_t all = comes ? late.which : 0;
          std::uint32_t stale = 7;
          if (k > 0) {
            CHECK(same(truepose_multirate_arrive(&sensors, all, time, now, &stale), {}));
            CHECK(stale == 0);
            late.arrived = all;
            if (comes && stamped) CHECK(stamp(late, 0, time[0], now));
          }
          truepose_real torque[TRUEPOSE_MOTORS];
          Outcome outcome;
          if (monitors) {
            outcome = control_fault_tolerant(robot, settings, watch, setpoint, q_e, state, keeps,
                                             seen, &late);
            CHECK(same(truepose_control_fault_tolerant(model, nullptr, &controller, &monitor,
                                                       &setpoint_c, q_e.data(), known,
                                                       known.work.data(), torque, &report),
                       outcome));
          } else {
            Extended present = q_e;
            Knowledge weighed;
            const Weighing by = compensated(robot, properties(law).weighs ? keeps : Weighing{},
                                            late, weighed, present);
            outcome = control(robot, settings, setpoint, present, state, by);
            CHECK(same(truepose_control(model, &controller, &setpoint_c, q_e.data(), known,
                                        known.work.data(), torque),
                       outcome));
          }
          CHECK(outcome && same(torque, state.torque));
        }
        const std::uint64_t time[kMaxSensors]{};
        std::uint32_t stale = 0;  // a sample of the distant past, and one without a time
        CHECK(same(truepose_multirate_arrive(&sensors, 1, time, 1000000000, &stale), {}));
        CHECK(stale == (stamped ? 1 : 0));
        CHECK(same(truepose_multirate_arrive(&sensors, 1, nullptr, 1000000000, &stale), {}));
        CHECK(stale == (stamped ? 1 : 0));
      }
}

TEST("slow sensors that none can have are refused, and their absence is allowed") {
  truepose_multirate sensors{};
  auto settings = in_c(MultirateSettings{});
  truepose_control_settings control;
  truepose_control_defaults(&control);
  truepose_controller controller = controller_in_c(control);
  CHECK(same(truepose_controller_sensors(&controller, &sensors), {Status::unfinished, -1}));
  CHECK(
      same(truepose_multirate_arrive(&sensors, 0, nullptr, 0, nullptr), {Status::unfinished, -1}));
  settings.age[3] = 256;
  CHECK(same(truepose_multirate_init(&sensors, sizeof sensors, &settings),
             {Status::no_such_part, 3}));
  CHECK(same(truepose_controller_sensors(&controller, &sensors), {Status::unfinished, -1}));
  settings.age[3] = 255;
  CHECK(same(truepose_multirate_init(&sensors, truepose_multirate_size() - 1, &settings),
             {Status::too_small, -1}));
  CHECK(same(truepose_multirate_init(&sensors, sizeof sensors, &settings), {}));
  CHECK(same(truepose_controller_sensors(&controller, &sensors), {}));
  CHECK(same(truepose_controller_sensors(&controller, nullptr), {}));
  --settings.size;
  CHECK(same(truepose_multirate_init(&sensors, sizeof sensors, &settings),
             {Status::other_version, -1}));
}

TEST_EACH(for_each,
          "a monitor in C finds a sensor that is gone, goes on without, and believes it again") {
  const ModelInC model(robot);
  KnownInC known(robot);
  truepose_controller controller = controller_in_c(in_c(settings_for(robot, Law::joint)));
  truepose_fault_monitor fault_state = monitor_in_c({});
  const truepose_setpoint setpoint = setpoint_in_c(robot.home);
  Extended q_e = readings_at(robot, robot.home);
  const int sensor = robot.motors;
  truepose_fault_report report;
  truepose_outcome outcome{};
  const auto cycles = [&](int count, double reading) {
    Extended read = q_e;
    read[sensor] = reading;
    truepose_real torque[TRUEPOSE_MOTORS];
    for (int k = 0; k < count; ++k)
      outcome =
          truepose_control_fault_tolerant(model, nullptr, &controller, &fault_state, &setpoint,
                                          read.data(), known, known.work.data(), torque, &report);
    for (int i = 0; i < robot.motors; ++i) CHECK(std::isfinite(torque[i]));
  };
  cycles(100, q_e[sensor]);
  CHECK(outcome.status == TRUEPOSE_OK && report.health[sensor] == TRUEPOSE_VALID);
  cycles(20, NAN);
  CHECK(outcome.status == TRUEPOSE_DISAGREE && outcome.part == sensor);
  CHECK(report.health[sensor] == TRUEPOSE_FAILED && report.symptom[sensor] == TRUEPOSE_MISSING);
  CHECK(!report.stops && report.brakes == 0 && report.stop == 0);
  CHECK(same(truepose_fault_monitor_acknowledge(&fault_state, sensor), {}));
  cycles(100, q_e[sensor]);
  CHECK(outcome.status == TRUEPOSE_OK && report.health[sensor] == TRUEPOSE_VALID);
  truepose_real believed[TRUEPOSE_READINGS] = {};
  Extended none = q_e;
  none[sensor] = NAN;
  truepose_fault_monitor_step(model, &fault_state, q_e.data(), none.data(), known,
                              known.work.data(), believed, &report);
  CHECK_NEAR(believed[sensor], q_e[sensor], 1e-6);
  CHECK(report.health[sensor] == TRUEPOSE_SUSPECT);
}

TEST_EACH(for_each, "a learner in C learns what the core's does") {
  check::Random random(5);
  const ModelInC model(robot);
  KnownInC known(robot);
  Prior twin(robot);
  const std::int32_t p = known.of.count;
  std::vector<truepose_real> memory(truepose_online_calibrator_memory(model, p));
  truepose_online_calibrator learner;
  CHECK(truepose_online_calibrator_init(&learner, sizeof learner, model, known, memory.data(),
                                        memory.size() - 1)
            .status == TRUEPOSE_TOO_SMALL);
  CHECK(truepose_online_calibrator_step(&learner, memory.data()).status == TRUEPOSE_UNFINISHED);
  CHECK(same(truepose_online_calibrator_init(&learner, sizeof learner, model, known, memory.data(),
                                             memory.size()),
             {}));
  OnlineCalibrator core = twin.learner(robot);
  core.settings = {};
  Robot truth = robot;
  truth.chain[0].encoder_offset += 1e-3;
  for (int k = 0; k < 10; ++k) {
    const Extended q_e = readings_at(truth, any_x(random));
    CHECK(same(truepose_online_calibrator_step(&learner, q_e.data()), calibrate_online(core, q_e)));
  }
  truepose_model learnt;
  truepose_knowledge after;
  CHECK(same(truepose_online_calibrator_model(&learner, &learnt, sizeof learnt), {}));
  CHECK(same(truepose_online_calibrator_knowledge(&learner, &after), {}));
  CHECK(after.count == p && std::equal(after.root, after.root + p * p, core.state.root));
  truepose_real q[TRUEPOSE_MOTORS] = {};
  Joint expected{};
  CHECK(same(truepose_ikm(&learnt, robot.home.data(), q),
             ikm(Level::ideal, core.robot, robot.home, expected)));
  CHECK(same(q, expected));
  int64_t counted = 0, left_out = 0;
  CHECK(same(truepose_online_calibrator_samples(&learner, &counted, &left_out), {}));
  CHECK(counted == core.lines && left_out == core.left_out && counted + left_out == 10);
  truepose_description kept;  // what was learnt can be kept, and loaded another day
  CHECK(same(truepose_description_of(&learnt, &kept), {}));
  const ModelInC again(kept);
  CHECK(same(again.outcome, {}));
  truepose_real q_again[TRUEPOSE_MOTORS] = {};
  CHECK(truepose_ikm(again, robot.home.data(), q_again).status == TRUEPOSE_OK);
  for (int i = 0; i < motors; ++i) CHECK_NEAR(q_again[i], q[i], 1e-14);
  CHECK(same(truepose_online_calibrator_roll_back(&learner), {}));
}

TEST_EACH(for_each, "a follower in C recognises what the core's does") {
  check::Random random(6);
  const ModelInC model(robot);
  KnownInC known(robot);
  Prior twin(robot);
  std::vector<truepose_real> memory(truepose_online_calibrator_memory(model, known.of.count));
  truepose_online_calibrator learner{};
  int64_t count = 0;
  truepose_recognised news[TRUEPOSE_RECOGNISED];
  CHECK(truepose_online_calibrator_changes(&learner, &count, news).status == TRUEPOSE_UNFINISHED);
  CHECK(same(truepose_online_calibrator_init(&learner, sizeof learner, model, known, memory.data(),
                                             memory.size()),
             {}));
  OnlineCalibrator core = twin.follower(robot);
  core.settings.changes.drifts = 0;
  const ChangeSettings& settings = core.settings.changes;
  const auto changes = std::bit_cast<truepose_changes>(settings);
  truepose_changes wrong = changes;
  ++wrong.steps;
  CHECK(truepose_online_calibrator_follow_memory(&learner, &wrong) == 0);
  CHECK(truepose_online_calibrator_follow(&learner, &wrong, nullptr, 0).status ==
        TRUEPOSE_NO_SUCH_VALUE);
  std::vector<truepose_real> more(truepose_online_calibrator_follow_memory(&learner, &changes));
  CHECK(
      truepose_online_calibrator_follow(&learner, &changes, more.data(), more.size() - 1).status ==
      TRUEPOSE_TOO_SMALL);
  CHECK(same(truepose_online_calibrator_follow(&learner, &changes, more.data(), more.size()), {}));
  Robot truth = robot;
  truth.chain[0].encoder_offset += 4e-3;
  for (int k = 0; k < 80; ++k) {
    const Extended q_e = readings_at(truth, any_x(random));
    CHECK(same(truepose_online_calibrator_step(&learner, q_e.data()), calibrate_online(core, q_e)));
  }
  CHECK(same(truepose_online_calibrator_changes(&learner, &count, news), {}));
  CHECK(count == core.state.window->recognised);
  for (int k = 0; k < count && k < kNews; ++k)
    CHECK(news[k].row == core.state.window->news[k].row &&
          news[k].which == core.state.window->news[k].which);
}

TEST("a path clock in C is the core's") {
  truepose_path_clock clock{0, 1, 0, 0};
  PathClock core;
  for (int k = 0; k < 300; ++k) {
    const double stop = k > 100 ? 0.15 : 0;
    truepose_advance(&clock, 1e-3, stop);
    core.advance(1e-3, stop);
    CHECK(clock.time == core.time && clock.rate == core.rate && clock.slowing == core.slowing);
  }
  truepose_setpoint setpoint{{1}, {1}, {1}};
  truepose_pace(&clock, &setpoint);
  CHECK(setpoint.rate[0] == 0 && setpoint.x[0] == 1);
}

TEST("what is no robot is refused, named, and answers nothing") {
  const auto table = in_c(h4().robot);
  struct Wrong {
    const char* what;
    void (*make)(truepose_description&);
    int status, part;
  };
  const Wrong wrongs[] = {
      {"version", [](auto& t) { t.abi = 1; }, TRUEPOSE_OTHER_VERSION, -1},
      {"size", [](auto& t) { --t.size; }, TRUEPOSE_OTHER_VERSION, -1},
      {"a pivot, of whose axes it says nothing", [](auto& t) { t.mobility = 6; },
       TRUEPOSE_NO_SUCH_VALUE, kAxisPart},
      {"chains", [](auto& t) { t.chains = 2000000; }, TRUEPOSE_NO_SUCH_PART, -1},
      {"sensors", [](auto& t) { t.sensors = 2000000; }, TRUEPOSE_NO_SUCH_PART, -1},
      {"bodies", [](auto& t) { t.bodies = -5; }, TRUEPOSE_NO_SUCH_PART, -1},
      {"mode", [](auto& t) { t.chain[1].working_mode = 0; }, TRUEPOSE_NO_SUCH_PART, 1},
      {"gravity", [](auto& t) { t.gravity[1] = NAN; }, TRUEPOSE_NOT_FINITE, -1},
      {"home", [](auto& t) { t.home[3] = INFINITY; }, TRUEPOSE_NOT_FINITE, -1},
      {"home far", [](auto& t) { t.home[2] = -4; }, TRUEPOSE_UNREACHABLE, 0},
      {"rod", [](auto& t) { t.chain[2].rod = NAN; }, TRUEPOSE_NOT_FINITE, 2},
      {"no rod", [](auto& t) { t.chain[2].rod = 0; }, TRUEPOSE_NO_SUCH_VALUE, 2},
      {"no arm", [](auto& t) { t.chain[3].arm = -0.26; }, TRUEPOSE_NO_SUCH_VALUE, 3},
      {"axis", [](auto& t) { t.chain[1].axis[1] *= 1.01; }, TRUEPOSE_NO_SUCH_VALUE, 1},
      {"stops", [](auto& t) { t.chain[0].low = 3, t.chain[0].high = 2; }, TRUEPOSE_NO_SUCH_VALUE,
       0},
      {"a stop", [](auto& t) { t.chain[0].low = NAN; }, TRUEPOSE_NOT_FINITE, 0},
      {"no gain", [](auto& t) { t.chain[0].encoder_gain = 0; }, TRUEPOSE_NO_SUCH_VALUE, 0},
      {"gear", [](auto& t) { t.sensor[0].gear = 0; }, TRUEPOSE_NO_SUCH_VALUE, kSensorPart},
      {"noise", [](auto& t) { t.sensor[0].noise = -1; }, TRUEPOSE_NO_SUCH_VALUE, kSensorPart},
      {"mass", [](auto& t) { t.body[0].mass = -1; }, TRUEPOSE_NO_SUCH_VALUE, kBodyPart},
      {"inertia", [](auto& t) { t.body[0].inertia[1] = 1; }, TRUEPOSE_NO_SUCH_VALUE, kBodyPart},
  };
  for (const Wrong& wrong : wrongs) {
    check::state().scene = wrong.what;
    truepose_description spoilt = table;
    wrong.make(spoilt);
    const ModelInC model(spoilt);
    CHECK(model.outcome.status == wrong.status && model.outcome.part == wrong.part);
    truepose_real q[TRUEPOSE_MOTORS] = {7, 7, 7, 7, 7, 7};
    CHECK(truepose_ikm(model, table.home, q).status == TRUEPOSE_UNFINISHED && q[0] == 7);
    CHECK(truepose_freedoms(model) == 0 && truepose_work(model, 5) == 0);
  }
  truepose_model model;
  std::memset(&model, 0x5a, sizeof model);
  truepose_real q[TRUEPOSE_MOTORS];
  CHECK(truepose_ikm(&model, table.home, q).status == TRUEPOSE_UNFINISHED);
  CHECK(truepose_load(&model, truepose_model_size() - 1, &table).status == TRUEPOSE_TOO_SMALL);
  CHECK(truepose_load(nullptr, sizeof model, &table).status == TRUEPOSE_TOO_SMALL);
  CHECK(same(truepose_load(&model, truepose_model_size(), &table), {}));
  CHECK(truepose_fkm(&model, table.home, 0, q).outcome.status == TRUEPOSE_NO_SUCH_VALUE);
}

TEST("a knowledge of parameters that the robot has not is refused, not read") {
  const Mechanism mechanism = h4();
  const Robot& robot = mechanism.robot;
  const ModelInC model(robot);
  KnownInC known(robot);
  truepose_control_settings control;
  truepose_control_defaults(&control);
  truepose_controller joint = controller_in_c(control);
  control.law = TRUEPOSE_LAW_WEIGHTED;
  truepose_controller controller = controller_in_c(control);
  truepose_fault_monitor fault_state = monitor_in_c({});
  const truepose_setpoint setpoint = setpoint_in_c(robot.home);
  std::vector<std::int32_t> column(known.of.column, known.of.column + known.of.count);
  known.table.column = column.data();
  const auto refused = [&](std::int32_t count, std::int32_t first, std::int32_t part) {
    known.table.count = count;
    column[0] = first;
    truepose_real q_e[TRUEPOSE_READINGS] = {}, out[TRUEPOSE_READINGS], x[TRUEPOSE_FREEDOMS] = {};
    truepose_fault_report report;
    truepose_servo_cycle cycle;
    CHECK(same(truepose_servo(model, TRUEPOSE_LAW_WEIGHTED, 0, setpoint.x, q_e, known,
                              known.work.data(), &cycle),
               {Status::no_such_part, part}));
    CHECK(truepose_control(model, &controller, &setpoint, q_e, known, known.work.data(), out)
              .status == TRUEPOSE_NO_SUCH_PART);
    CHECK(truepose_controller_servo(model, &controller, setpoint.x, q_e, known, known.work.data(),
                                    &cycle)
              .status == TRUEPOSE_NO_SUCH_PART);
    // A law that does not weigh does not look at it; a monitor does.
    CHECK(truepose_control(model, &joint, &setpoint, q_e, known, known.work.data(), out).status ==
          TRUEPOSE_OK);
    CHECK(truepose_control_fault_tolerant(model, nullptr, &joint, &fault_state, &setpoint, q_e,
                                          known, known.work.data(), out, &report)
              .status == TRUEPOSE_NO_SUCH_PART);
    CHECK(truepose_fault_monitor_step(model, &fault_state, q_e, q_e, known, known.work.data(), out,
                                      &report)
              .status == TRUEPOSE_NO_SUCH_PART);
    CHECK(truepose_estimate(model, known, q_e, known.work.data(), x).outcome.status ==
          TRUEPOSE_NO_SUCH_PART);
  };
  refused(known.of.count, 2000000, 0);
  refused(known.of.count, -1, 0);
  refused(-1, 0, -1);
  refused(2000000, 0, -1);
  truepose_real q_e[TRUEPOSE_READINGS] = {}, x[TRUEPOSE_FREEDOMS] = {};
  CHECK(truepose_estimate(model, nullptr, q_e, known.work.data(), x).outcome.status ==
        TRUEPOSE_NOT_MEASURED);
}

TEST("settings that no controller or monitor can have are refused") {
  truepose_control_settings control;
  truepose_control_defaults(&control);
  truepose_controller controller;
  const auto begun = [&](auto change) {
    truepose_control_settings settings = control;
    change(settings);
    return truepose_controller_init(&controller, sizeof controller, &settings).status;
  };
  CHECK(begun([](auto&) {}) == TRUEPOSE_OK);
  CHECK(begun([](auto& s) { s.size = 0; }) == TRUEPOSE_OTHER_VERSION);
  CHECK(begun([](auto& s) { ++s.size; }) == TRUEPOSE_OTHER_VERSION);
  // Settings of an earlier release, without `ki`: the default 0 is used, whatever the memory holds.
  CHECK(begun([](auto& s) { s.ki[0] = NAN; }) == TRUEPOSE_NOT_FINITE);
  CHECK(begun([](auto& s) {
          s.size = offsetof(truepose_control_settings, ki);
          s.ki[0] = NAN;
        }) == TRUEPOSE_OK);
  CHECK(begun([](auto& s) { s.law = 5; }) == TRUEPOSE_NO_SUCH_PART);
  CHECK(begun([](auto& s) { s.sigma_scale = 0; }) == TRUEPOSE_OK);
  CHECK(begun([](auto& s) { s.sigma_scale = -1; }) == TRUEPOSE_NO_SUCH_VALUE);
  CHECK(begun([](auto& s) { s.period = 0; }) == TRUEPOSE_NO_SUCH_VALUE);
  CHECK(begun([](auto& s) { s.kp[5] = NAN; }) == TRUEPOSE_NOT_FINITE);
  CHECK(truepose_change_law(&controller, -1).status == TRUEPOSE_NO_SUCH_PART);
  const auto monitor = in_c(FaultMonitorSettings{});
  truepose_fault_monitor fault_state;
  const auto monitored = [&](auto change) {
    truepose_fault_monitor_settings settings = monitor;
    change(settings);
    return truepose_fault_monitor_init(&fault_state, sizeof fault_state, &settings).status;
  };
  CHECK(monitored([](auto&) {}) == TRUEPOSE_OK);
  CHECK(monitored([](auto& s) { s.size = 8; }) == TRUEPOSE_OTHER_VERSION);
  CHECK(monitored([](auto& s) { s.spikes = 9; }) == TRUEPOSE_NO_SUCH_VALUE);
  CHECK(monitored([](auto& s) { s.false_alarm = 1; }) == TRUEPOSE_NO_SUCH_VALUE);
  CHECK(monitored([](auto& s) { s.low[3] = NAN; }) == TRUEPOSE_NOT_FINITE);
  CHECK(monitored([](auto&) {}) == TRUEPOSE_OK);
  auto& setup = *c::FaultTolerantSetup::of(&fault_state);
  CHECK(!setup.settings.limited);
  truepose_safety_limits limits{};
  CHECK(truepose_fault_monitor_limit(&fault_state, &limits).status == TRUEPOSE_OTHER_VERSION);
  limits.size = sizeof limits;
  limits.period = 2e-3;
  CHECK(truepose_fault_monitor_limit(&fault_state, &limits).status == TRUEPOSE_OK);
  CHECK(setup.settings.limited && setup.settings.limits.period == 2e-3);
  limits.period = 0;
  CHECK(truepose_fault_monitor_limit(&fault_state, &limits).status == TRUEPOSE_NO_SUCH_VALUE);
  limits.torque[0] = NAN;
  CHECK(truepose_fault_monitor_limit(&fault_state, &limits).status == TRUEPOSE_NOT_FINITE);
  CHECK(setup.settings.limited && setup.settings.limits.period == 2e-3);
  CHECK(truepose_fault_monitor_frame(&fault_state, 7).status == TRUEPOSE_OK);
  CHECK(setup.state.frame.given && setup.state.frame.value == 7);
  truepose_real led[TRUEPOSE_MOTORS] = {0.1};
  CHECK(truepose_fault_monitor_led(&fault_state, led).status == TRUEPOSE_OK);
  led[5] = NAN;
  CHECK(truepose_fault_monitor_led(&fault_state, led).status == TRUEPOSE_NOT_FINITE);
  CHECK(c::FaultTolerantSetup::of(&fault_state)->state.monitor.led[0] == 0.1);
  std::memset(&fault_state, 0, sizeof fault_state);
  CHECK(truepose_fault_monitor_acknowledge(&fault_state, 0).status == TRUEPOSE_UNFINISHED);
}

TEST("every status has the core's number and says what it is") {
  for (int status = TRUEPOSE_STOPPED; status <= TRUEPOSE_NO_SUCH_VALUE; ++status)
    CHECK(status == 12 ||  // of an earlier interface
          std::strcmp(truepose_status_text(status), "unknown status") != 0);
  CHECK(TRUEPOSE_NO_SUCH_VALUE == static_cast<int>(Status::no_such_value));
  CHECK(TRUEPOSE_LAW_ESTIMATED == static_cast<int>(Law::estimated));
  CHECK(TRUEPOSE_AXIS_ANGLE == static_cast<int>(SensorKind::axis_angle));
  CHECK(TRUEPOSE_DISAGREES == static_cast<int>(Symptom::disagrees));
  CHECK(truepose_abi() == TRUEPOSE_ABI);
}

TEST_EACH(for_each, "a servo cycle in one call is IKM, J, TEJ and motor error of their own calls") {
  check::Random random(11);
  const ModelInC c_model(robot);
  Model model;
  CHECK(model.load(c_model.table));
  CHECK(model.freedoms() == n && model.motors() == motors && model.sensors() == robot.r);
  for (const truepose_law law : {TRUEPOSE_LAW_JOINT, TRUEPOSE_LAW_TEJ, TRUEPOSE_LAW_CARTESIAN}) {
    if (law != TRUEPOSE_LAW_JOINT && redundancy(robot) == 0) continue;
    const Coordinates x = any_x(random);
    Extended q_e{};
    Joint q{};
    ServoCycle e;
    std::array<Joint, 6> J;
    std::array<Extended, TRUEPOSE_MOTORS> tej;
    CHECK(model.readings(x, q_e) && model.ikm(x, q) && model.jacobian(x, J) && model.tej(x, tej));
    for (int i = 0; i < motors + robot.r; ++i) q_e[i] += 1e-4 * random();
    truepose_servo_cycle cycle;
    CHECK(model.servo(law, x, q_e, cycle));
    CHECK(servo_cycle(robot, static_cast<Law>(law), x, q_e, e));
    CHECK(same(cycle.error, e.error) && same(cycle.q_d, q));
    CHECK(std::memcmp(cycle.J, &J, sizeof J) == 0);
    const bool by_readings = law == TRUEPOSE_LAW_TEJ;
    CHECK((std::memcmp(cycle.tej, &tej, sizeof tej) == 0) == by_readings);
    for (int i = 0; i < n; ++i) {
      const Real off = std::fabs(cycle.x[i] - x[i]);
      CHECK(law == TRUEPOSE_LAW_CARTESIAN ? off > 0 && off < 0.1 : off == 0);
    }
  }
  Joint untouched{};
  CHECK(Model().ikm(robot.home, untouched).status == Status::unfinished);
}

TEST_EACH(for_each_square,
          "joint states conserve power, and motor commands act on the joints as commanded") {
  check::Random random(12);
  const ModelInC c_model(robot);
  Model model;
  CHECK(model.load(c_model.table));
  for (int k = 0; k < 10; ++k) {
    const Coordinates x = any_x(random, 0.3);
    Coordinates near = x;
    truepose_axis_state motors{}, joints{};
    for (int i = 0; i < n; ++i) {
      motors.velocity[i] = random();
      motors.torque[i] = random();
      near[i] += 1e-3 * random();
    }
    CHECK(same(truepose_ikm(c_model, x.data(), motors.position), {}));
    std::copy_n(near.begin(), 6, joints.position);
    CHECK(model.joint_state(motors, joints));
    Real power = 0, joint_power = 0, along = 0;
    for (int i = 0; i < n; ++i) {
      CHECK_NEAR(joints.position[i], x[i], 1e-9);
      power += motors.torque[i] * motors.velocity[i];
      joint_power += joints.torque[i] * joints.velocity[i];
    }
    CHECK_NEAR(joint_power, power, 1e-9 * (1 + std::fabs(power)));
    // Velocities against finite differences of the motors' positions along them.
    constexpr Real kStep = 1e-6;
    Joint q_near{};
    Coordinates rate{};
    std::copy_n(joints.velocity, 6, rate.begin());
    for (Real& value : rate) value *= kStep;
    CHECK(ikm(Level::ideal, robot, to_coordinates(K, moved(K, to_pose(K, x), rate)), q_near));
    for (int i = 0; i < n; ++i)
      along =
          std::max(along, std::fabs((q_near[i] - motors.position[i]) / kStep - motors.velocity[i]));
    CHECK(along < 1e-3);

    truepose_axis_command wanted{}, given{};
    for (int i = 0; i < n; ++i) {
      wanted.state.position[i] = near[i];
      wanted.state.velocity[i] = random();
      wanted.state.torque[i] = random();
      wanted.kp[i] = 50 + 10 * random();
      wanted.kd[i] = 2 + random();
    }
    CHECK(model.motor_command(motors, joints, wanted, given));
    truepose_axis_state acting = motors, felt = joints;
    Joint q_d{};
    CHECK(model.ikm(near, q_d));
    for (int i = 0; i < n; ++i) {
      CHECK_NEAR(given.state.position[i], q_d[i], 1e-12);
      CHECK(given.kp[i] > 0 && given.kd[i] > 0);
      acting.torque[i] = given.state.torque[i] +
                         given.kp[i] * (given.state.position[i] - motors.position[i]) +
                         given.kd[i] * (given.state.velocity[i] - motors.velocity[i]);
    }
    CHECK(model.joint_state(acting, felt));
    const Coordinates away = difference(K, to_pose(K, near), to_pose(K, x));
    for (int i = 0; i < n; ++i) {
      const Real asked = wanted.state.torque[i] + wanted.kp[i] * away[i] +
                         wanted.kd[i] * (wanted.state.velocity[i] - joints.velocity[i]);
      CHECK_NEAR(felt.torque[i], asked, 1e-7 * (1 + std::fabs(asked)));
    }
  }
  truepose_axis_state broken{}, kept{};
  broken.velocity[0] = NAN;
  CHECK(same(truepose_ikm(c_model, robot.home.data(), broken.position), {}));
  std::copy_n(robot.home.begin(), 6, kept.position);
  CHECK(model.joint_state(broken, kept).status == Status::not_finite);
  CHECK(kept.torque[0] == 0);
}
