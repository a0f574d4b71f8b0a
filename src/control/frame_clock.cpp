// Age of frames of readings, from their counter or timestamp.
#include "control/frame_clock.hpp"

namespace truepose {
FrameAge FrameClock::advance(FrameMark mark, Real per, std::uint64_t mask, int age) {
  if (!begun) {
    begun = mark.given;
    last = mark.value;
    return FrameAge::fresh;
  }
  const std::uint64_t ahead = mark.given ? (mark.value - last) & mask : 0;
  if (mark.given) last = mark.value;
  if (ahead > mask >> 1) {
    behind = 0;
    return FrameAge::backwards;
  }
  const Real advance = Real(std::int64_t(ahead)) / per;
  const Real older = behind + 1 - advance;
  jitter = max(jitter, std::abs(advance - 1));
  const Real most = age + kJitter;
  const bool old = older - kClockDrift > most;
  behind = clamp(older - kClockDrift, Real{0}, most);
  if (old) return FrameAge::old;
  if (older < -most) return FrameAge::dropped;
  return ahead == 0 ? FrameAge::repeated : FrameAge::fresh;
}
}  // namespace truepose
