#include "control/fault_tolerant_control.hpp"

namespace truepose {
void release(FaultTolerantState& fault_state) {
  fault_state.stops = false;
  fault_state.brakes = 0;
  fault_state.stop = fault_state.unanswered = fault_state.stopping = 0;
}

void observe_forces(const Robot& robot, const FaultTolerantSettings& settings, Real period,
                    bool moves, const Joint& torque, FaultTolerantState& state) {
  if (!kObserves) return;
  const int n = dof(robot.mobility);
  FaultMonitor& monitor = state.monitor;
  MomentumObserver& observer = state.observer;
  bool observed = moves && !state.stops;
  for (int i = 0; i < n; ++i)
    observed =
        observed && monitor.reading[i].health == Health::valid && !monitor.reading[i].noise.noisy();
  if (!observed) {
    observer = {};
  } else {  // the observer takes several periods as one, and works in each of them
    const Real several = settings.momentum.period / period;
    const int every = several > 1 && several < 100 ? static_cast<int>(several + Real(0.5)) : 1;
    for (int i = 0; i < n; ++i) observer.sum[i] += torque[i];
    if (++observer.waited >= every) {
      Joint mean{};
      for (int i = 0; i < n; ++i) mean[i] = observer.sum[i] / static_cast<Real>(every);
      observer.sum = {};
      observer.waited = 0;
      sample_momentum(robot, settings.momentum, monitor.pose, mean, observer);
    }
    for (int done = 0; done < kMomentumSteps; done += every)
      static_cast<void>(observe_momentum(robot, settings.momentum, observer));
  }
  for (int i = 0; i < n; ++i)
    monitor.pushed[i] = std::fabs(observer.residual[i]) * settings.momentum.give[i];
}
}  // namespace truepose
