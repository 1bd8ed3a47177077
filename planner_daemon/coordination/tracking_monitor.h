// How far the robot is from where its motion says that it is.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "lcmtypes/bus/time.h"

namespace swarm {

// The largest error lately bounds the next ones: wind, a soft controller or a poor estimate of its place keep a robot
// off its motion for seconds, not for an instant.
class TrackingMonitor {
 public:
  // What the clearance of every robot allows for anyhow.
  static constexpr double kAllowed_m = 0.1;

  // The bound is `largest_m` at most; more than `off_course_m` away, for a while, the robot is off course.
  TrackingMonitor(double largest_m, double off_course_m) : largest_m_(largest_m), off_course_m_(off_course_m) {}

  // So far it was at `utime`. Later ones come later.
  void saw(Utime utime, double error_m) {
    newest_m_ = error_m;
    newest_utime_ = utime;
    off_since_ = error_m > off_course_m_ ? std::min(off_since_, utime) : kNever;
    if (is_off_course()) off_utime_ = utime;
    const std::int64_t number = utime.time_since_epoch() / kShare;
    Share& share = shares_[static_cast<std::size_t>(number % kNumShares)];
    if (share.number != number) share = {number, 0.0};
    share.largest_m = std::max(share.largest_m, error_m);
  }
  double newest_m() const { return newest_m_; }
  // Beyond what is allowed for, in whole centimetres, so that it seldom changes.
  double bound_m(Utime now) const {
    const std::int64_t number = now.time_since_epoch() / kShare;
    double error_m = 0.0;
    for (const Share& share : shares_) {
      if (share.number <= number && share.number > number - kNumShares) error_m = std::max(error_m, share.largest_m);
    }
    const double beyond_cm = std::ceil(100.0 * (error_m - kAllowed_m) - 1e-6);
    return std::clamp(beyond_cm / 100.0, 0.0, largest_m_);
  }
  bool is_off_course() const { return off_since_ != kNever && newest_utime_ - off_since_ >= kForAWhile; }
  // Within the last second.
  bool was_off_course(Utime now) const { return off_utime_ <= now && now < off_utime_ + 1s; }
  // Another motion begins where the robot is.
  void back_on_course() { off_since_ = kNever; }
  // The clock was set: what was seen at other times counts for nothing.
  void forget() { *this = TrackingMonitor(largest_m_, off_course_m_); }

 private:
  static constexpr Duration kShare = 500ms;
  static constexpr std::int64_t kNumShares = 7;  // the newest has begun: 3 s and a little more
  static constexpr Duration kForAWhile = 200ms;  // a jump of a sensor is over by then
  struct Share {                                 // of the time
    std::int64_t number = -kNumShares;
    double largest_m = 0.0;
  };

  double largest_m_, off_course_m_;
  double newest_m_ = 0.0;
  Utime newest_utime_{};
  Utime off_since_ = kNever, off_utime_ = Utime::min();
  std::array<Share, kNumShares> shares_{};
};

}  // namespace swarm
