// The time that nodes live by: near to the computer's wall clock, and yet steady.
#pragma once

#include <cstdint>

namespace swarm {

// Microseconds since the epoch, by the computer's wall clock, which operators and time servers may set.
std::int64_t wall_utime();

// Microseconds since the computer was started, sleep included; nobody sets this one.
std::int64_t steady_us();

// Both at the same time, within 0.1 ms if that can be had: whoever is interrupted between the two reads them again.
struct ClockReading {
  std::int64_t steady_us = 0, wall_us = 0;
};
ClockReading read_clocks();

// Goes on steadily and follows the wall clock: where that one is slewed, by as much (10 % at most); where it is
// stepped, by more than kStep_us, not before the step is adopted. Knows no clock but the readings it is handed; those
// of the steady clock must not go back.
class NodeClock {
 public:
  static constexpr std::int64_t kStep_us = 20'000;
  static constexpr std::int64_t kSlewShare = 10;  // of the time that has passed, one in so many

  explicit NodeClock(const ClockReading& first)
      : steady_us_(first.steady_us), offset_us_(first.wall_us - first.steady_us) {}

  // Takes a reading and returns the node's time [us since epoch]; until adopt_step() never before what was returned
  // last.
  std::int64_t read(const ClockReading& reading);

  // By how much the wall clock was ahead at the newest reading, when it has been stepped; 0: it has not, or is back.
  std::int64_t step_us() const { return step_us_; }
  // From now on the node's time is the wall clock's.
  void adopt_step();

 private:
  std::int64_t steady_us_, offset_us_;  // of the node's time to the steady clock
  std::int64_t step_us_ = 0;
  std::int64_t rest_us_ = 0;  // too short a time for a microsecond of slew
};

}  // namespace swarm
