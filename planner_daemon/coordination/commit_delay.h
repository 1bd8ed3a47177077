// How long a plan takes from its start until it is announced (planning, PlanDelay) and from then until it is committed
// (acknowledgements of the peers, CommitDelay). So much earlier than it leaves the committed motion must it be begun.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "lcmtypes/bus/time.h"

namespace swarm {

// So long before it begins, a trajectory that is urgent is committed without the answers that have not come.
inline constexpr Duration kLastMoment = 10ms;

// The longest but one of the newest kNumKept: one that was unusual counts for nothing.
class PlanDelay {
 public:
  static constexpr double kMargin_s = 0.001;

  explicit PlanDelay(double first_s) : first_s_(first_s) {}
  void took(double delay_s) {
    if (!(delay_s >= 0.0 && delay_s <= 1.0)) return;  // not of a plan of ours
    newest_[count_++ % kNumKept] = delay_s;
  }
  // What is to be expected [s]; as long as nothing is known, what the constructor was told.
  double lead_s() const {
    if (count_ == 0) return first_s_;
    double longest_s = newest_[0], next_s = count_ == 1 ? newest_[0] : 0.0;
    for (std::size_t i = 1; i < std::min(count_, kNumKept); ++i) {
      next_s = std::max(next_s, std::min(longest_s, newest_[i]));
      longest_s = std::max(longest_s, newest_[i]);
    }
    return next_s + kMargin_s;
  }

 private:
  static constexpr std::size_t kNumKept = 16;
  double first_s_;
  std::array<double, kNumKept> newest_{};
  std::size_t count_ = 0;
};

// A running mean and deviation, as of TCP's round trips (Jacobson, SIGCOMM 1988). Each plan that was not committed in
// time widens it until the next one that was.
class CommitDelay {
 public:
  static constexpr double kLongest_s = 1.5, kMargin_s = 0.003;

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
  static constexpr double kWiden = 1.25;
  double mean_s_ = -1.0, deviation_s_ = 0.0, at_least_s_ = 0.0, one_way_s_ = 0.0;
};

}  // namespace swarm
