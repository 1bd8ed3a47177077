#include "planner_daemon/give_way.h"

#include <algorithm>

namespace swarm {
namespace {

constexpr double kApart_m = 0.5, kArrived_m = 0.1;
constexpr double kHeadOn_m = 1.5;               // so near two meet
constexpr double kAlone_m = 5.0;                // and so far from all others
constexpr double kBack_m = 6.0, kRoom_m = 0.2;  // the way goes on so far both ways; so far beside it
constexpr double kPassed_m = 0.5;               // beyond where they met
constexpr Duration kWaits = 6s;                 // beside the way
constexpr Duration kGoesOn = 30s;               // waiting for nobody who did not come

}  // namespace

std::optional<Eigen::Vector3d> GiveWay::place(Utime now, const PlanRequest& request, Planner& planner) {
  const std::optional<Eigen::Vector3d> place = apart(request);
  return place ? place : beside(now, request, planner);
}

void GiveWay::shift(Duration step) {
  if (beside_) beside_->until += step;
  for (auto& [id, until] : stayed_) until += step;
}

// From there every plan would be in the peer's way, and be refused for ever.
std::optional<Eigen::Vector3d> GiveWay::apart(const PlanRequest& request) const {
  const Utime utime = request.start_utime;
  const Eigen::Vector3d place = request.own.at(utime).position;
  if (request.own.end_utime() > utime || (place - request.goal).norm() < kArrived_m) return {};
  const double usual_m = config_.space.blocked_m() + 0.5 * request.sogm->geometry.resolution_m;
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
  const Eigen::Vector3d gone = peer->motion.at(now).position - beside_->met;
  if (gone.dot(beside_->way) > kPassed_m) return false;
  if (now < beside_->until && beside_->until <= now + kWaits) return true;
  stayed_[beside_->peer_id] = now;
  return false;
}

// Two alone, head on where only one fits through: whoever has the higher id goes back to a place beside the other's way
// until that one has passed.
std::optional<Eigen::Vector3d> GiveWay::beside(Utime now, const PlanRequest& request, Planner& planner) {
  if (beside_ && still_waits(now, request)) return beside_->place;
  if (beside_) planner.is_not_stuck(now);
  beside_.reset();
  if (!planner.is_stuck(request.start_utime)) return {};
  const Eigen::Vector3d place = request.own.at(request.own.end_utime()).position;
  const Peer* met = nullptr;
  for (const Peer& peer : *request.peers) {
    if ((peer.motion.at(request.start_utime).position - place).norm() >= kAlone_m) continue;
    if (met != nullptr) return {};  // the way beside would be another's way
    met = &peer;
  }
  if (met == nullptr || met->id > robot_id_) return {};
  if (const auto stayed = stayed_.find(met->id); stayed != stayed_.end() && now < stayed->second + kGoesOn) return {};
  const Eigen::Vector3d from = met->motion.at(request.start_utime).position;
  const double distance_m = (place - from).norm();
  if (distance_m > kHeadOn_m || distance_m == 0.0) return {};
  const Eigen::Vector3d way = (place - from) / distance_m;
  const double apart_m = config_.space.blocked_m() + met->radius_m + kRoom_m;
  const auto refuge = planner.refuge(request, from - kBack_m * way, from + kBack_m * way, apart_m);
  if (refuge) beside_ = {*refuge, now + kWaits, met->id, place, way};
  return refuge;
}

}  // namespace swarm
