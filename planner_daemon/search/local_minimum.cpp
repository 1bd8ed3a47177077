#include "planner_daemon/search/local_minimum.h"

#include <algorithm>

namespace swarm {
namespace {

constexpr double kProgress_m = 0.3;  // so much nearer is on its way
constexpr double kSetback_m = 1.0;   // so much farther: another way, for other reasons
constexpr Duration kPatience = 2500ms, kStands = 300ms;
constexpr double kLeast_m = 1.0, kMost_m = 8.0;  // of the way that it is led, twice as far each time it was not enough

}  // namespace

bool LocalMinimum::leads(Utime utime, const Eigen::Vector3d& goal, double way_m, bool stands) {
  if (goal != goal_) *this = LocalMinimum();
  goal_ = goal;
  if (until_m_ && way_m > *until_m_) return true;
  const bool has_moved = !mark_ || way_m < mark_->way_m - kProgress_m || way_m > mark_->way_m + kSetback_m;
  if (until_m_ || has_moved || mark_->utime > utime) mark_ = {utime, way_m};
  until_m_.reset();
  if (!stands || !stands_since_ || *stands_since_ > utime) stands_since_ = utime;
  if (utime - mark_->utime < kPatience && utime - *stands_since_ < kStands) return false;
  far_m_ = way_m > stuck_m_ - far_m_ ? std::clamp(2 * far_m_, kLeast_m, kMost_m) : kLeast_m;
  stuck_m_ = way_m;
  until_m_ = way_m - far_m_;
  return true;
}

void LocalMinimum::give_up(Utime utime) {
  until_m_.reset();
  mark_.reset();
  stands_since_ = utime;
}

}  // namespace swarm
