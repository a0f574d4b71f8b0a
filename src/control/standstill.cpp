// Stuck readings: unchanged counts while the model moves.
//
// A frozen encoder drives its motor away (driven_way.hpp).
#include "control/monitored_cycle.hpp"

namespace truepose::fault_monitor_detail {
namespace {
/// Share of `moved` by which the setpoint must have left a reading that stands still.
constexpr Real kLed = 0.2;
/// σ by which a motor may deviate from its usual following error: one that oscillates about its
/// path, for example by a law with a delayed sensor, stands still at its turning points.
constexpr Real kDeviates = 8;
/// Log odds of a motor that stands against a frozen encoder from which on it is held: 1 in 150.
constexpr Real kHeld = 5;
}  // namespace

Real MonitoredCycle::tolerated_motion(int c, Real share) const {
  const MonitoredReading& reading = monitor.reading[c];
  return max(share * settings.moved[c], kDeviates * sqrt(reading.following.variance)) +
         2 * reading.standstill.forced_error;
}

Real MonitoredCycle::setpoint(int c) const {
  if (c < n) return desired[c] + monitor.led[c];
  Real value = parity.expected[c];
  for (int j : range(n)) value += parity.g[c - n][j] * (desired[j] - parity.expected[j]);
  return number(value) ? value : monitor.reading[c].standstill.driven.from;
}

Real MonitoredCycle::model_motion(int c, Real way) const {
  const MonitoredReading& reading = monitor.reading[c];
  const Standstill& still = reading.standstill;
  const Real by = model(c) - still.model + way, side = copysign(Real(1), by);
  // A law that holds a platform moves its motors where one of them drifts, and a sensor stands at
  // its setpoint; where a sensor is wrong, a motor that the law leads against its setpoint turns
  // back. Only what the setpoint has left counts; off q_d both of its measures are approximate.
  Real led = side * (setpoint(c) - still.driven.from + way);
  if (c >= n) led = min(led, side * still.setpoint_motion);
  if (!(led > kLed * settings.moved[c])) return 0;
  Real variance = 0;  // of the change, between cycles at rest, of a sensor's value by the motors
  for (int j = 0; c >= n && j < n; ++j)
    variance += 2 * parity.g[c - n][j] * parity.g[c - n][j] * noise[j];
  // Motion of a motor towards its setpoint does not count.
  return min(fabs(by), fabs(by + reading.following.deviation)) - settings.sigmas * sqrt(variance);
}

bool MonitoredCycle::motor_stands(int c, Real moved) const {
  ReadingCovariance V;
  if (c >= n || r == 0 || !monitor.known || !monitor.placed || !covariance(1, 1, V)) return false;
  Reading y = parity.value;
  V.whiten(r, y.data(), 1);
  const Column error = column_of(c, V, y);
  // Log odds of the error -moved against none.
  return -moved * (error.score + Real{0.5} * moved * error.information) < -kHeld;
}

void MonitoredCycle::update_standstill(int c, bool judged) {
  MonitoredReading& reading = monitor.reading[c];
  Standstill& still = reading.standstill;
  // Setpoints are known from the second cycle on.
  if (raw(c) != still.reading || monitor.cycle - monitor.began < 2) {
    const bool known = c < n || monitor.placed;
    const Real from = known ? setpoint(c) : still.driven.from;
    const Real at = known ? model(c) : still.model;
    still = {};
    still.reading = raw(c);
    still.model = at;
    still.driven.from = from;
    still.forced_error = c < n ? monitor.pushed[c] : 0;
    return;
  }
  still.cycles = min(still.cycles + 1, kMostCounted);  // a robot may stand still for months
  for (int j = 0; c >= n && monitor.placed && j < n; ++j) {
    const Real by = parity.g[c - n][j] * (desired[j] - monitor.desired[j]);
    still.setpoint_motion += number(by) ? by : 0;
  }
  if (c < n && !still.stuck)
    still.driven.advance(settings.period, settings.kp[c], settings.kd[c], setpoint(c), 0,
                         settings.rests[c] + 2 * still.forced_error);
  if (!judged) return;
  const Real share = monitor.undecided ? 3 : 1;
  if (!(model_motion(c, still.driven.way) > tolerated_motion(c, share)) &&
      (monitor.undecided || !(fabs(still.driven.way) > tolerated_motion(c, kStoodBy))))
    return;
  if (motor_stands(c, model(c) - still.model + still.driven.way)) return;
  if (!still.stuck)
    reading.following.led_out = {reading.following.usual + reading.following.deviation, 0};
  still.stuck = true;
  if (!delayed(c) && !monitor.undecided) return;
  reading.health = Health::failed;
  reading.symptom = Symptom::stuck;
}
}  // namespace truepose::fault_monitor_detail
