// What a node does again and again.
#pragma once

#include <algorithm>
#include <cstdint>

namespace swarm {

// Remembers when it was done last. A clock that goes back makes nobody wait for the time that was before: then it
// counts as done just now. All times in microseconds since the epoch.
class Recurring {
 public:
  void done(std::int64_t now_us) { last_us_ = now_us; }

  // When it is due again, at once if it was never done: a period after it was done last, at `now_us` + period the
  // latest.
  std::int64_t due_us(std::int64_t now_us, std::int64_t period_us) {
    last_us_ = std::min(last_us_, now_us);
    return last_us_ + period_us;
  }
  // The same on a grid: at the next whole multiple of the period.
  std::int64_t due_on_grid_us(std::int64_t now_us, std::int64_t period_us) {
    last_us_ = std::min(last_us_, now_us);
    return (last_us_ / period_us + 1) * period_us;
  }

 private:
  std::int64_t last_us_ = 0;
};

}  // namespace swarm
