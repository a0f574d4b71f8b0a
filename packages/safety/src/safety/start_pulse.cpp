// Push and opening time of a start-up test's pulses, within the bound of the platform's motion.
#include "safety/start_pulse.hpp"

namespace truepose::start_detail {
StartPulse pulse_within(const StartSettings& settings, Real period, const StartMotor& motor) {
  const Real error = settings.weight * motor.weight, unseen = kBlind * error;
  const Real worst = Real(0.5) * settings.inertia * motor.response * motor.lever;
  const Real bound = 2 * settings.motion, most = kSafe * bound;
  const auto cycles = [&](Real push) {
    return std::sqrt(most / (worst * (push + unseen))) / period;
  };
  const auto push_for = [&](Real count) {
    return most / (worst * (count * period) * (count * period)) - unseen;
  };
  const Real deflection = (motor.turns ? kBrakeTurns : kBrakeSlides) * motor.lever;
  const Real brakes = (1 - kSafe) * bound / (kSwings * deflection) * motor.torque;
  const Real least = 6 * motor.friction + 2 * error;
  // Pulses begin at one cycle, by which a robot like its model moves by half of `motion` at most.
  const Real cycle = worst / settings.inertia * period * period + 2 * deflection / motor.torque;
  const Real highest =
      std::min({brakes, settings.motion / (2 * cycle), motor.torque - motor.weight - error});
  const Real wanted = std::floor(std::min(settings.pulse / period, cycles(least)) + kPart);
  const auto push_of = [&](Real count) { return std::min(push_for(count), highest); };
  const auto moves = [&](Real count) { return (push_of(count) - motor.friction) * count * count; };
  const Real shortest = cycles(highest);
  const Real fewer = std::max({Real(1), wanted, std::floor(shortest + kPart)});
  const Real more = std::max(fewer, std::ceil(shortest - kPart));
  StartPulse pulse;
  pulse.push = push_of(moves(more) > moves(fewer) ? more : fewer);
  const Real longest = cycles(pulse.push) + kPart;
  if (std::isfinite(longest)) pulse.longest = static_cast<int>(std::min(longest, Real(1000)));
  return pulse;
}
}  // namespace truepose::start_detail
