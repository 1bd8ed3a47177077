#include "lcmtypes/bus/node_clock.h"

#include <time.h>

#include <algorithm>

namespace swarm {
namespace {

Duration read(clockid_t clock) {
  timespec time{};
  ::clock_gettime(clock, &time);
  return std::chrono::seconds(time.tv_sec) +
         std::chrono::duration_cast<Duration>(std::chrono::nanoseconds(time.tv_nsec));
}

}  // namespace

Utime wall_utime() {
  return Utime(read(CLOCK_REALTIME));
}

Duration uptime() {
  return read(CLOCK_BOOTTIME);
}

std::chrono::nanoseconds stopwatch() {
  return std::chrono::steady_clock::now().time_since_epoch();
}

ClockReading read_clocks() {
  constexpr Duration kSame = 100us;
  constexpr int kTries = 5;
  ClockReading best;
  Duration least = Duration::max(), before = uptime();
  for (int i = 0; i < kTries && least > kSame; ++i) {
    const Utime wall = wall_utime();
    const Duration after = uptime();
    if (after - before < least) best = {before + (after - before) / 2, wall};
    least = std::min(least, after - before);
    before = after;
  }
  return best;
}

Utime NodeClock::read(const ClockReading& reading) {
  const Duration passed = std::max(reading.uptime - uptime_, Duration());
  uptime_ += passed;
  const Duration ahead = reading.wall - (started_ + uptime_);
  if (std::chrono::abs(ahead) > kStep) {
    step_ = ahead;
  } else {
    step_ = Duration();
    const Duration most = (rest_ + passed) / kSlewShare;
    rest_ = (rest_ + passed) % kSlewShare;
    started_ += std::clamp(ahead, -most, most);
  }
  return started_ + uptime_;
}

void NodeClock::adopt_step() {
  started_ += std::exchange(step_, Duration());
}

}  // namespace swarm
