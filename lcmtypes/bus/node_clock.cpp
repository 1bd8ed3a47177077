#include "lcmtypes/bus/node_clock.h"

#include <time.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <utility>

namespace swarm {
namespace {

std::int64_t read_us(clockid_t clock) {
  timespec time{};
  ::clock_gettime(clock, &time);
  return std::int64_t{time.tv_sec} * 1'000'000 + time.tv_nsec / 1000;
}

}  // namespace

std::int64_t wall_utime() {
  return read_us(CLOCK_REALTIME);
}

std::int64_t steady_us() {
  return read_us(CLOCK_BOOTTIME);
}

ClockReading read_clocks() {
  constexpr std::int64_t kSame_us = 100;
  constexpr int kTries = 5;
  ClockReading best;
  std::int64_t least_us = std::numeric_limits<std::int64_t>::max(), before_us = steady_us();
  for (int i = 0; i < kTries && least_us > kSame_us; ++i) {
    const std::int64_t wall_us = wall_utime(), after_us = steady_us();
    if (after_us - before_us < least_us) best = {before_us + (after_us - before_us) / 2, wall_us};
    least_us = std::min(least_us, after_us - before_us);
    before_us = after_us;
  }
  return best;
}

std::int64_t NodeClock::read(const ClockReading& reading) {
  const std::int64_t passed_us = std::max<std::int64_t>(reading.steady_us - steady_us_, 0);
  steady_us_ += passed_us;
  const std::int64_t ahead_us = reading.wall_us - (steady_us_ + offset_us_);
  if (std::abs(ahead_us) > kStep_us) {
    step_us_ = ahead_us;
  } else {
    step_us_ = 0;
    const std::int64_t most_us = (rest_us_ + passed_us) / kSlewShare;
    rest_us_ = (rest_us_ + passed_us) % kSlewShare;
    offset_us_ += std::clamp(ahead_us, -most_us, most_us);
  }
  return steady_us_ + offset_us_;
}

void NodeClock::adopt_step() {
  offset_us_ += std::exchange(step_us_, 0);
}

}  // namespace swarm
