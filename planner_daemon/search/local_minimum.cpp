#include "planner_daemon/search/local_minimum.h"

#include <algorithm>

namespace swarm {
namespace {

constexpr double kProgress_m = 0.3;  // so much nearer is on its way,
constexpr double kProgress_s = 0.3;  // or what so much of full speed makes
constexpr double kSetback_m = 1.0;   // so much farther: another way, for other reasons
constexpr Duration kPatience = 2500ms, kStands = 300ms;
constexpr Duration kLed = 10s;  // at most: what stopped it may be gone
constexpr int kMostInVain = 4;
constexpr double kLeast_m = 1.0, kMost_m = 8.0;  // of the way that it is led, twice as far each time it was not enough

}  // namespace

bool LocalMinimum::leads(Utime utime, const Eigen::Vector3d& goal, double way_m, bool stands, double v_max_mps) {
  if (goal != goal_) *this = LocalMinimum();
  goal_ = goal;
  if (until_m_) {
    const bool is_there = way_m <= *until_m_, is_late = utime >= until_ || until_ > utime + kLed;
    if (!is_there && !is_late) return true;
    in_vain_ = is_there ? 0 : std::min(in_vain_ + 1, kMostInVain);
    give_up(utime);
  }
  const double progress_m = std::min(kProgress_m, kProgress_s * v_max_mps);
  const bool has_moved = !mark_ || way_m < mark_->way_m - progress_m || way_m > mark_->way_m + kSetback_m;
  if (has_moved || mark_->utime > utime) mark_ = {utime, way_m};
  if (!stands || !stands_since_ || *stands_since_ > utime) stands_since_ = utime;
  const int patience = 1 << in_vain_;  // twice as long each time it was led in vain
  if (utime - mark_->utime < patience * kPatience && utime - *stands_since_ < patience * kStands) return false;
  far_m_ = way_m > stuck_m_ - far_m_ ? std::clamp(2 * far_m_, kLeast_m, kMost_m) : kLeast_m;
  stuck_m_ = way_m;
  until_m_ = way_m - far_m_;
  until_ = utime + kLed;
  return true;
}

void LocalMinimum::give_up(Utime utime) {
  until_m_.reset();
  mark_.reset();
  stands_since_ = utime;
}

}  // namespace swarm
