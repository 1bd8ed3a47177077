// How long a plan takes from its start until it is committed: computing, announcing, acknowledgements of the peers. So
// much earlier than it leaves the committed motion must it be begun.
#pragma once

#include <algorithm>
#include <cmath>

#include "lcmtypes/bus/time.h"

namespace swarm {

// So long before it begins, a trajectory that is urgent is committed without the answers that have not come.
inline constexpr Duration kLastMoment = 10ms;

// A running mean and deviation, as of TCP's round trips (Jacobson, SIGCOMM 1988). Each plan that was not committed in
// time widens it until the next one that was.
class CommitDelay {
 public:
  static constexpr double kLongest_s = 1.5;

  void committed(double after_s) {
    if (!(after_s >= 0.0 && after_s <= kLongest_s)) return;  // not of a plan of ours
    if (mean_s_ < 0.0) mean_s_ = after_s;
    deviation_s_ += (std::abs(after_s - mean_s_) - deviation_s_) / 4;
    mean_s_ += (after_s - mean_s_) / 8;
    at_least_s_ = 0.0;
  }
  bool is_unanswered() const { return at_least_s_ > 0.0; }  // the newest plan was missed
  void missed(double lead_s) {
    if (lead_s >= 0.0 && lead_s < 2 * kLongest_s) at_least_s_ = std::max(at_least_s_, kWiden * lead_s);
  }
  // Until a plan was committed: a peer's message takes so long.
  void heard(double one_way_s) { one_way_s_ += (one_way_s - one_way_s_) / 8; }

  // What is to be expected [s].
  double lead_s() const { return std::min(kLongest_s, std::max(at_least_s_, usual_s())); }
  // As if all peers answered.
  double usual_s() const {
    const double answered_s = mean_s_ < 0.0 ? 2 * one_way_s_ : mean_s_ + 2.5 * deviation_s_;
    return std::min(kLongest_s, answered_s + kMargin_s);
  }

 private:
  static constexpr double kWiden = 1.25, kMargin_s = 0.01;
  double mean_s_ = -1.0, deviation_s_ = 0.0, at_least_s_ = 0.0, one_way_s_ = 0.0;
};

}  // namespace swarm
