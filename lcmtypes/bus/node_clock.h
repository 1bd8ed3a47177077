// The time that nodes live by: near to the computer's wall clock, and yet steady.
#pragma once

#include <functional>
#include <utility>

#include "lcmtypes/bus/time.h"

namespace swarm {

// By the computer's wall clock, which operators and time servers may set.
Utime wall_utime();

// Since the computer was started, sleep included; nobody sets this one.
Duration uptime();

// Both at the same time, within 0.1 ms if that can be had: whoever is interrupted between the two reads them again.
struct ClockReading {
  Duration uptime{};
  Utime wall{};
};
ClockReading read_clocks();

// For measuring how long something takes; null where nobody measures.
using Stopwatch = std::function<std::chrono::nanoseconds()>;
std::chrono::nanoseconds stopwatch();

// Goes on steadily and follows the wall clock: where that one is slewed, by as much (10 % at most); where it is
// stepped, by more than kStep, not before the step is adopted. Knows no clock but the readings it is handed; the
// uptime of those must not go back.
class NodeClock {
 public:
  static constexpr Duration kStep = 20ms;
  static constexpr int kSlewShare = 10;  // of the time that has passed, one in so many

  explicit NodeClock(const ClockReading& first) : uptime_(first.uptime), started_(first.wall - first.uptime) {}

  // Takes a reading and returns the node's time; until adopt_step() never before what was returned last.
  Utime read(const ClockReading& reading);

  // By how much the wall clock was ahead at the newest reading, when it has been stepped; 0: it has not, or is back.
  Duration step() const { return step_; }
  // From now on the node's time is the wall clock's.
  void adopt_step();

  // What hosts do before each call of a node: offers it a step, and adopts it if take(step) says so. It is offered
  // again each time until it is taken; take(0) tells that the wall clock is back.
  enum class Offer { kNone, kTaken, kRefused, kRefusedAgain };
  template <class Take>
  Offer offer_step(const Take& take) {
    const bool was_offered = std::exchange(is_offered_, step_ != Duration());
    if (!is_offered_) {
      if (was_offered) (void)take(step_);
      return Offer::kNone;
    }
    if (!take(step_)) return was_offered ? Offer::kRefusedAgain : Offer::kRefused;
    adopt_step();
    is_offered_ = false;
    return Offer::kTaken;
  }

 private:
  Duration uptime_;
  Utime started_;  // when the computer was, by the node's time
  Duration step_{};
  bool is_offered_ = false;  // the step, and it was not taken
  Duration rest_{};          // too short a time for a microsecond of slew
};

}  // namespace swarm
