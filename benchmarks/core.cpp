// Speed of the core: the time of one call each.
#include <cstring>

#include "bench.hpp"
#include "inputs.hpp"
#include "truepose/full/linearise.hpp"
#include "truepose/offline/simulate.hpp"
#include "truepose/offline/statics.hpp"

using namespace inputs;

namespace {

constexpr int kRepeats = 51;

template <Mobility K>
void kinematics(const std::string& name, const Inputs<K>& in, std::vector<bench::Row>& rows) {
  const auto add = [&](const char* what, auto f) {
    rows.push_back(bench::measure(name + " " + what, kPoses, kRepeats, f));
  };
  add("IKM", [&](int i) {
    Joint q;
    bench::keep(ikm(in.robot, in.x[i], q));
    bench::keep(q);
  });
  add("IKM + J", [&](int i) {
    Closure<K> closure;
    Jacobians<K> jacobians;
    bench::keep(ikm<K>(in.robot, to_pose<K>(in.x[i]), closure));
    bench::keep(jacobian<K>(closure, jacobians));
    bench::keep(jacobians);
  });
  // The calls that Python makes: coordinates in, any mobility, joint limits asked for.
  add("q = IKM(x)", [&](int i) {
    Joint q;
    bench::keep(ikm(in.robot, in.x[i], q));
    bench::keep(q);
  });
  add("J(x)", [&](int i) {
    JointMatrix J;
    bench::keep(jacobian(in.robot, in.x[i], J));
    bench::keep(J);
  });
  add(kRotational<K> ? "FKM from 10 mrad" : "FKM from 1 mm, 1 mrad", [&](int i) {
    Coordinates x = in.near[i];
    bench::keep(fkm(in.robot, in.q[i], x));
    bench::keep(x);
  });
  add(kRotational<K> ? "FKM from neutral" : "FKM from home", [&](int i) {
    Coordinates x = kRotational<K> ? Coordinates{} : in.robot.home;
    bench::keep(fkm(in.robot, in.q[i], x));
    bench::keep(x);
  });
}

/// The full level: its own Newton both ways, 8 rods of an H4.
template <Mobility K>
void full_level(const std::string& name, const Inputs<K>& in, std::vector<bench::Row>& rows) {
  const auto add = [&](const char* what, auto f) {
    rows.push_back(bench::measure(name + " full level, " + what, kPoses, kRepeats, f));
  };
  add("IKM", [&](int i) {
    Joint q;
    bench::keep(ikm_full(in.robot, in.x[i], q));
    bench::keep(q);
  });
  add("J from x", [&](int i) {
    JointMatrix J;
    bench::keep(jacobian_full(in.robot, in.x[i], J));
    bench::keep(J);
  });
  std::vector<double> H_xi((kDof<K> + in.robot.r) * parameter_count(in.robot));
  add("q_e, H_x, H_ξ from x", [&](int i) {
    Extended q_e;
    Matrix<kMaxReadings, kDof<K>> H_x;
    bench::keep(linearise_full<K>(in.robot, to_pose<K>(in.x[i]), q_e, H_x, H_xi.data()));
    bench::keep(H_x);
  });
  add("FKM from 1 mm, 1 mrad", [&](int i) {
    Coordinates x = in.near[i];
    bench::keep(fkm_full(in.robot, in.q[i], x));
    bench::keep(x);
  });
}

/// The robot as built: rods of -3 to +10 mm, arms of -0.4 to +0.6 mm, as in the paper's simulation.
Robot built(const Robot& nominal) {
  check::Random random(2);
  Robot truth = nominal;
  for (int i = 0; i < 4; ++i) {
    truth.chain[i].rod += 3.5e-3 + 6.5e-3 * random();
    truth.chain[i].arm += 1e-4 + 5e-4 * random();
  }
  return truth;
}

}  // namespace

int main(int argc, char** argv) {
  constexpr Mobility K = Mobility::schoenflies;
  const Inputs<K> h4(mechanisms::h4());
  const Inputs<Mobility::spatial> ups(mechanisms::hexapod("6-UPS", Actuator::telescopic));
  std::vector<bench::Row> rows;

  kinematics<K>("H4", h4, rows);
  Inputs<K> turned = h4;  // axes 0.1° off: the full level then differs from the ideal one
  for (int i = 0; i < 4; ++i) {
    Chain& chain = turned.robot.chain[i];
    const double angle = mechanisms::degrees(i % 2 == 0 ? 0.1 : -0.1);
    chain.axis = exp_so3(angle * chain.zero()) * chain.axis();
  }
  full_level<K>("H4", turned, rows);
  rows.push_back(bench::measure("H4 FKM, closed, θ known", kPoses, kRepeats, [&](int i) {
    Vec3 D = Vec3::Zero();
    bench::keep(fkm_closed<K>(h4.robot, h4.q[i], h4.R[i], Vec3(0, 0, -0.4), D));
    bench::keep(D);
  }));
  rows.push_back(bench::measure("H4 TEJ from x (IKM, J, RKM, TEJ)", kPoses, kRepeats, [&](int i) {
    ExtendedColumns M;
    ExtendedRows M_plus;
    bench::keep(tej(h4.robot, h4.x[i], M, M_plus));
    bench::keep(M_plus);
  }));
  for (const FeedForward feed : {FeedForward::none, FeedForward::full})
    for (const Law law : kLaws) {
      const ControlSettings settings = settings_for(h4.robot, law, feed);
      ControlState state;
      rows.push_back(bench::measure(
          std::string("H4 control cycle, ") + kLawNames[static_cast<int>(law)] +
              (feed == FeedForward::none ? ", no feed-forward" : ", full feed-forward"),
          kPoses, kRepeats, [&](int i) {
            bench::keep(control<K>(h4.robot, settings, h4.setpoint[i], h4.q_e[i], state));
          }));
    }

  mechanisms::Prior prior(h4.robot);
  for (const Law law : kWeighing) {
    const ControlSettings settings = settings_for(h4.robot, law, FeedForward::full);
    ControlState state;
    rows.push_back(bench::measure(std::string("H4 control cycle, ") +
                                      kLawNames[static_cast<int>(law)] + ", full feed-forward",
                                  kPoses, kRepeats, [&](int i) {
                                    bench::keep(control<K>(h4.robot, settings, h4.setpoint[i],
                                                           h4.q_e[i], state, prior.weighing()));
                                  }));
  }

  // On a path, in counts, as a machine's readings are: what the monitor adds to the paper's law.
  {
    const ControlSettings settings = settings_for(h4.robot, Law::tej, FeedForward::full);
    FaultTolerantSettings fault_settings;
    fault_settings.monitor.fastest.fill(500);
    fault_settings.monitor.moved.fill(2e-3);
    prepare(fault_settings.monitor);
    std::vector<Setpoint> path(kPoses);
    std::vector<Extended> read(kPoses);
    for (int i = 0; i < kPoses; ++i) {
      path[i] =
          quintic<K>({-0.05, 0, -0.42, 0.2}, {0.05, 0.05, -0.4, -0.2}, 1e-3 * kPoses, 1e-3 * i);
      if (!extended<K>(h4.robot, to_pose<K>(path[i].x), read[i])) std::printf("out of reach\n");
      for (int c = 0; c < 5; ++c) read[i][c] = 3e-5 * std::nearbyint(read[i][c] / 3e-5);
    }
    ControlState plain, state;
    FaultMonitor seen;
    FaultTolerantState fault_state;
    Extended believed;
    rows.push_back(bench::measure("H4 control cycle, TEJ, on a path", kPoses, kRepeats, [&](int i) {
      if (i == 0) plain = {};
      bench::keep(control<K>(h4.robot, settings, path[i], read[i], plain));
    }));
    rows.push_back(bench::measure("H4 monitor, on a path", kPoses, kRepeats, [&](int i) {
      if (i == 0) seen = {};
      bench::keep(monitor_faults<K>(h4.robot, fault_settings.monitor, prior.weighing(),
                                    motors_of<K>(read[i]), read[i], seen, believed));
    }));
    rows.push_back(
        bench::measure("H4 fault-tolerant cycle, TEJ, on a path", kPoses, kRepeats, [&](int i) {
          if (i == 0) {
            state = {};
            fault_state = {};
          }
          bench::keep(control_fault_tolerant<K>(h4.robot, settings, fault_settings, path[i],
                                                read[i], state, prior.weighing(), fault_state));
        }));
  }

  Robot rods = turned.robot;
  rods.level = Level::full;
  for (const Law law : {Law::joint, Law::weighted, Law::estimated}) {
    const ControlSettings settings = settings_for(rods, law, FeedForward::full);
    ControlState state;
    rows.push_back(bench::measure(std::string("H4 control cycle rod by rod, ") +
                                      kLawNames[static_cast<int>(law)] + ", full feed-forward",
                                  kPoses, kRepeats, [&](int i) {
                                    bench::keep(control<K>(rods, settings, turned.setpoint[i],
                                                           turned.q_e[i], state, prior.weighing()));
                                  }));
  }

  const Robot truth = built(h4.robot);
  rows.push_back(bench::measure("H4 statics, 625 poses x 3 laws", 1, kRepeats, [&](int) {
    for (const Law law : kLaws) {
      StaticsSettings settings;
      settings.control.law = law;
      for (int k = 0; k < 625; ++k) {
        Coordinates x;
        bench::keep(settle<K>(h4.robot, truth, settings, h4.x[k], x));
        bench::keep(x);
      }
    }
  }));
  for (const Law law : kLaws) {
    const Run run{{0, 0, -0.5, 0}, {0.1, -0.1, -0.4, 0.2}, 0.2, 0.2, 2};
    const ControlSettings settings = settings_for(h4.robot, law, FeedForward::full);
    const auto row = bench::measure(
        std::string("H4 0.2 s move + 0.2 s hold, ") + kLawNames[static_cast<int>(law)], 1, kRepeats,
        [&](int) {
          bench::keep(Loop<K>(h4.robot, truth, settings, run.from, run.seed)
                          .move(run, [](const Sample& sample) { bench::keep(sample); }));
        });
    rows.push_back(row);
  }
  kinematics<Mobility::spatial>("6-UPS", ups, rows);
  kinematics<Mobility::rotational_2>(
      "G1 ankle", Inputs<Mobility::rotational_2>(pivots_tested::g1_ankle()), rows);

  if (argc > 1 && std::strcmp(argv[1], "--json") == 0) {
    bench::print_json(rows);
    return 0;
  }
  bench::print_table(rows);
  for (const bench::Row& row : rows)
    if (row.name.find("0.2 s move") != std::string::npos)
      std::printf("%s: %.0f times faster than real time\n", row.name.c_str(), 0.4 / row.median);
  return 0;
}
