// What a node does again and again.
#pragma once

#include <algorithm>

#include "lcmtypes/bus/time.h"

namespace swarm {

// Remembers when it was done last. A clock that goes back makes nobody wait for the time that was before: then it
// counts as done just now.
class Recurring {
 public:
  void done(Utime now) { last_ = now; }

  // When it is due again, at once if it was never done: a period after it was done last, at `now` + period the latest.
  Utime due(Utime now, Duration period) {
    last_ = std::min(last_, now);
    return last_ + period;
  }
  // The same on a grid: at the next whole multiple of the period since the epoch.
  Utime due_on_grid(Utime now, Duration period) {
    last_ = std::min(last_, now);
    return Utime((last_.time_since_epoch() / period + 1) * period);
  }

 private:
  Utime last_{};
};

}  // namespace swarm
