#include "planner_daemon/give_way.h"

#include <algorithm>
#include <limits>

namespace swarm {
namespace {

constexpr double kApart_m = 0.5, kArrived_m = 0.1;
constexpr double kMet_m = 1.5, kParted_m = 3.0;         // so near two have met, and so far apart they have parted
constexpr double kAlone_m = 5.0;                        // so far from all others
constexpr Duration kHeldUp = 2s, kHeldUpLong = 12s;     // with the lower id: the other one finds no place
constexpr double kProgress_m = 0.3, kProgress_s = 0.3;  // is made by so much, or what so much of full speed makes
constexpr double kRoom_m = 0.2, kBack_m = 0.5;          // so far beside the way
constexpr double kAway_m = 1.0;                         // from the way that it was let
constexpr Duration kWaits = 6s;                         // beside the way, while the peer does not come
constexpr Duration kGoesOn = 30s;                       // waiting for nobody who did not come

// Of points.
auto nearest(const std::vector<Eigen::Vector3d>& points, const Eigen::Vector3d& place) {
  return std::ranges::min_element(points, {}, [&](const Eigen::Vector3d& at) { return (at - place).squaredNorm(); });
}

}  // namespace

std::optional<Eigen::Vector3d> GiveWay::place(Utime now, const PlanRequest& request, Planner& planner) {
  const std::optional<Eigen::Vector3d> place = apart(request);
  return place ? place : beside(now, request, planner);
}

void GiveWay::shift(Duration step) {
  if (beside_) beside_->until += step;
  if (meeting_) meeting_->since += step;
  for (auto& [id, until] : stayed_) until += step;
}

// From there every plan would be in the peer's way, and be refused for ever.
std::optional<Eigen::Vector3d> GiveWay::apart(const PlanRequest& request) const {
  const Utime utime = request.start_utime;
  const Eigen::Vector3d place = request.own.at(utime).position;
  if (request.own.end_utime() > utime || (place - request.goal).norm() < kArrived_m) return {};
  const double usual_m = config_.space.blocked_m() + request.margin_m + 0.5 * request.sogm->geometry.resolution_m;
  for (const Peer& peer : *request.peers) {
    if (peer.motion.end_utime() > utime) continue;
    const Eigen::Vector3d away = place - peer.motion.at(utime).position;
    const double distance_m = away.norm();
    if (distance_m < usual_m + peer.radius_m && distance_m > 0.0) return place + kApart_m / distance_m * away;
  }
  return {};
}

bool GiveWay::still_waits(Utime now, const PlanRequest& request) {
  const auto peer = std::ranges::find(*request.peers, beside_->peer_id, &Peer::id);
  if (peer == request.peers->end()) return false;
  const StaticHeuristic::Refuge& refuge = beside_->refuge;
  const Eigen::Vector3d place = peer->motion.at(now).position;
  const auto at = nearest(refuge.way, place), until = nearest(refuge.way, refuge.place);
  if (at > until || (*at - place).norm() > kAway_m) return false;
  double to_pass_m = 0.0;
  for (auto next = at; next != until; ++next) to_pass_m += (next[1] - next[0]).norm();
  const double left_m = to_pass_m + (request.own.at(now).position - refuge.place).norm();
  if (left_m < beside_->left_m - kProgress_m) {
    beside_->left_m = left_m;
    beside_->until = now + kWaits;
  }
  if (now < beside_->until && beside_->until <= now + kWaits) return true;
  stayed_[beside_->peer_id] = now;
  return false;
}

Duration GiveWay::held_up(Utime now, const PlanRequest& request, const Planner& planner, const Peer& met) {
  const MotionState state = request.own.at(now);
  const double distance_m = (met.motion.at(now).position - state.position).norm();
  const std::optional<double> way_m = planner.way_m(request);
  if (!way_m || *way_m < kArrived_m || distance_m > (meeting_ ? kParted_m : kMet_m)) {
    meeting_.reset();
    return 0s;
  }
  const double progress_m = std::min(kProgress_m, kProgress_s * request.v_max_mps);
  if (!meeting_ || meeting_->peer_id != met.id || meeting_->since > now || *way_m < meeting_->way_m - progress_m)
    meeting_ = {met.id, *way_m, now};
  return now - meeting_->since;
}

// Two alone, head on where only one fits through: whoever has the higher id goes back to a place beside the other's way
// until that one has passed; if it knows none, it goes back as far as it sees, and looks again; if it does not get away
// either, the other one goes back.
std::optional<Eigen::Vector3d> GiveWay::beside(Utime now, const PlanRequest& request, Planner& planner) {
  const Eigen::Vector3d place = request.own.at(request.start_utime).position;
  const bool looks_again = beside_ && !beside_->refuge.is_apart && (place - beside_->refuge.place).norm() < kBack_m;
  if (beside_ && !looks_again && still_waits(now, request)) return beside_->refuge.place;
  if (beside_) meeting_.reset();
  beside_.reset();
  const Peer* met = nullptr;
  for (const Peer& peer : *request.peers) {
    if ((peer.motion.at(request.start_utime).position - place).norm() >= kAlone_m) continue;
    if (met != nullptr) return {};  // the way beside would be another's way
    met = &peer;
  }
  if (met == nullptr) return {};
  if (const auto stayed = stayed_.find(met->id); stayed != stayed_.end() && now < stayed->second + kGoesOn) return {};
  const Eigen::Vector3d from = met->motion.at(request.start_utime).position;
  const double distance_m = (place - from).norm();
  const Duration held_up = this->held_up(now, request, planner, *met);
  const bool is_held_up = distance_m < kMet_m && held_up >= (met->id < robot_id_ ? kHeldUp : kHeldUpLong);
  if (distance_m == 0.0 || (!looks_again && !is_held_up)) return {};
  meeting_.reset();
  const auto refuge = planner.refuge(request, *met, config_.space.blocked_m() + met->radius_m + kRoom_m);
  if (!refuge || (refuge->place - place).norm() < kBack_m) return {};
  beside_ = {*refuge, now + kWaits, met->id, std::numeric_limits<double>::infinity()};
  return refuge->place;
}

}  // namespace swarm
