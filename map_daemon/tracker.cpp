#include "map_daemon/tracker.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "lcmtypes/bus/codec.h"

namespace swarm {
namespace {

using sogm_swarm::obstacle_t;
using sogm_swarm::obstacles_t;

constexpr double kSurprise = 25.0;         // of six degrees of freedom: one report in 3,000 is so far from its track
constexpr double kNear2 = 16.0;            // of three: where a track may find itself again under another id
constexpr double kNear_m = 0.3;            // and this much beside
constexpr double kUnknownSpeed_mps = 1.0;  // standard deviation of a velocity that nobody measured
constexpr double kLasting_s = 0.5;         // over which velocities and their changes are averaged to find accelerations
constexpr double kNoise = 2.0;             // of the variance of a velocity: more than noise makes of the changes
constexpr double kTurning = 1.4;           // one whose direction turns within seconds seems so much smaller than it is
constexpr double kMost_mps2 = 4.0;         // that an obstacle is taken to accelerate by
constexpr Duration kOnceMore = 100ms;      // that what was seen once is kept
constexpr std::size_t kUsualTracks = 128;  // for so many there is memory from the beginning
constexpr std::size_t kMaxPairs = 1 << 16;  // of tracks and reports that are compared

Shape::Kind to_kind(std::int16_t shape) {
  switch (shape) {
    case obstacle_t::kRing:
      return Shape::Kind::kRing;
    case obstacle_t::kBox:
      return Shape::Kind::kBox;
    case obstacle_t::kSphere:
      return Shape::Kind::kSphere;
    default:
      return Shape::Kind::kColumn;
  }
}

// One measurement, of variance `noise`, of what has variance `variance`: what of the surprise is to be believed.
double gain(double shared, double variance, double noise) {
  const double sum = variance + noise;
  return sum > 0.0 ? shared / sum : 0.0;
}

// How far the velocity is from what it lately was tells an acceleration from noise, within about a second. `dt_s`:
// since the last one.
void learn_acceleration(double dt_s, Track* track) {
  if (track->obstacle.utime - track->unbroken_utime < to_duration(kLasting_s)) {  // it may not have been known before
    track->lasting_velocity = track->obstacle.velocity;
    return;
  }
  const double news = dt_s / (kLasting_s + dt_s);
  track->lasting_velocity += news * (track->obstacle.velocity - track->lasting_velocity);
  const double change = (track->obstacle.velocity - track->lasting_velocity).squaredNorm();
  track->changes += news * (change - kNoise * track->covariance.velocity - track->changes);
  const double acceleration_mps2 = kTurning * std::sqrt(std::max(track->changes, 0.0)) / kLasting_s;
  track->obstacle.acceleration_mps2 = std::min(acceleration_mps2, kMost_mps2);
}

// The indices of items by their ids. Of one id the first comes first, as std::stable_sort has it, which takes memory.
template <class IdOf, class Item>
void order_by_id(const IdOf& id_of, const std::vector<Item>& items, std::vector<std::size_t>* order) {
  order->resize(items.size());
  std::iota(order->begin(), order->end(), std::size_t{0});
  std::ranges::sort(*order, {}, [&](std::size_t i) { return std::pair(id_of(items[i]), i); });
}

bool is_alike(const Shape& a, const Shape& b) {
  return a.kind == b.kind && (a.size - b.size).cwiseAbs().maxCoeff() <= 0.5 * a.size.cwiseMax(b.size).maxCoeff();
}

}  // namespace

TrackCovariance TrackCovariance::after(double dt_s, double density) const {
  return {position + dt_s * (2.0 * both + dt_s * (velocity + dt_s * density / 3.0)),
          both + dt_s * (velocity + dt_s * density / 2.0), velocity + dt_s * density};
}

Tracker::Tracker(const TrackerConfig& config) : config_(config) {
  for (auto* const tracks : {&tracks_, &unseen_, &found_}) tracks->reserve(kUsualTracks);
  for (auto* const detections : {&seen_, &unknown_}) detections->reserve(kUsualTracks);
  order_.reserve(kUsualTracks);
}

Tracker::Detection Tracker::detection_of(const obstacle_t& message, Utime utime) const {
  Detection detection;
  detection.id = message.id;
  detection.obstacle = {
      .shape = {.kind = to_kind(message.shape), .size = Eigen::Vector3d(message.size), .yaw_rad = message.yaw},
      .position = Eigen::Vector3d(message.position),
      .velocity = Eigen::Vector3d(message.velocity),
      .utime = utime - to_duration(message.age_s > 0.0 ? message.age_s : config_.latency_s)};
  detection.position_var = double{message.position_sigma} * message.position_sigma;
  detection.has_velocity = message.velocity_sigma >= 0.0f;
  detection.velocity_var = detection.has_velocity ? double{message.velocity_sigma} * message.velocity_sigma
                                                  : kUnknownSpeed_mps * kUnknownSpeed_mps;
  if (!detection.has_velocity) detection.obstacle.velocity.setZero();
  return detection;
}

Track Tracker::begun(const Detection& detection, Utime utime) const {
  return {.id = detection.id,
          .obstacle = detection.obstacle,
          .covariance = {detection.position_var, 0.0, detection.velocity_var},
          .lasting_velocity = detection.obstacle.velocity,
          .unbroken_utime = detection.obstacle.utime,
          .first_utime = utime,
          .last_utime = utime};
}

void Tracker::correct(const Detection& detection, Utime utime, Track* track) const {
  track->id = detection.id;
  track->last_utime = utime;
  const Obstacle& seen = detection.obstacle;
  const double dt_s = std::max(0.0, to_seconds(seen.utime - track->obstacle.utime));
  TrackCovariance p = track->covariance.after(dt_s, density());
  Eigen::Vector3d position = track->obstacle.position + dt_s * track->obstacle.velocity;
  Eigen::Vector3d velocity = track->obstacle.velocity;
  const Eigen::Vector3d amiss_m = seen.position - position, amiss_mps = seen.velocity - velocity;
  double surprise = amiss_m.squaredNorm() / std::max(p.position + detection.position_var, 1e-9);
  if (detection.has_velocity) surprise += amiss_mps.squaredNorm() / std::max(p.velocity + detection.velocity_var, 1e-9);
  const bool is_exact = detection.position_var == 0.0 && detection.has_velocity && detection.velocity_var == 0.0;
  if (is_exact || surprise > kSurprise) {  // it is known better, or has turned: the past says nothing
    const double acceleration_mps2 = is_exact ? 0.0 : track->obstacle.acceleration_mps2;
    track->obstacle = seen;
    track->obstacle.acceleration_mps2 = acceleration_mps2;
    track->covariance = {detection.position_var, 0.0, detection.velocity_var};
    track->lasting_velocity = seen.velocity;
    track->unbroken_utime = seen.utime;
    if (is_exact) track->changes = 0.0;
    return;
  }
  double of_position = gain(p.position, p.position, detection.position_var);
  double of_velocity = gain(p.both, p.position, detection.position_var);
  position += of_position * amiss_m;
  velocity += of_velocity * amiss_m;
  p = {(1.0 - of_position) * p.position, (1.0 - of_position) * p.both, p.velocity - of_velocity * p.both};
  if (detection.has_velocity) {
    const Eigen::Vector3d rest_mps = seen.velocity - velocity;
    of_position = gain(p.both, p.velocity, detection.velocity_var);
    of_velocity = gain(p.velocity, p.velocity, detection.velocity_var);
    position += of_position * rest_mps;
    velocity += of_velocity * rest_mps;
    p = {p.position - of_position * p.both, (1.0 - of_velocity) * p.both, (1.0 - of_velocity) * p.velocity};
  }
  const Utime newest = std::max(seen.utime, track->obstacle.utime);
  track->obstacle.shape = seen.shape;
  track->obstacle.position = position;
  track->obstacle.velocity = velocity;
  track->obstacle.utime = newest;
  track->covariance = p;
  learn_acceleration(dt_s, track);
}

bool Tracker::is_kept(const Track& track, Utime utime) const {
  const Duration seen_for = track.last_utime - track.first_utime, unseen_for = utime - track.last_utime;
  return unseen_for <= std::min(to_duration(config_.timeout_s), 2 * seen_for + kOnceMore);
}

void Tracker::update(const obstacles_t& report) {
  const Utime utime = to_utime(report.header.utime);
  seen_.clear();
  for (const obstacle_t& obstacle : report.obstacles) seen_.push_back(detection_of(obstacle, utime));
  unseen_.clear();
  unknown_.clear();
  found_.clear();
  order_by_id([](const Detection& detection) { return detection.id; }, seen_, &order_);
  auto known = tracks_.begin();
  for (const std::size_t i : order_) {  // both are in the order of their ids
    const Detection& detection = seen_[i];
    while (known != tracks_.end() && known->id < detection.id) unseen_.push_back(*known++);
    if (known != tracks_.end() && known->id == detection.id) {
      correct(detection, utime, &found_.emplace_back(*known++));
    } else {
      unknown_.push_back(detection);
    }
  }
  unseen_.insert(unseen_.end(), known, tracks_.end());
  if (!report.complete) adopt(utime, &unseen_, &unknown_, &found_);
  for (const Detection& detection : unknown_) found_.push_back(begun(detection, utime));
  for (const Track& track : unseen_) {
    if (!report.complete && is_kept(track, utime)) found_.push_back(track);
  }
  order_by_id([](const Track& track) { return track.id; }, found_, &order_);
  tracks_.clear();
  for (const std::size_t i : order_) tracks_.push_back(found_[i]);
}

void Tracker::adopt(Utime utime, std::vector<Track>* unseen, std::vector<Detection>* unknown,
                    std::vector<Track>* tracks) const {
  if (unseen->size() * unknown->size() > kMaxPairs) return;
  std::erase_if(*unknown, [&](const Detection& detection) {
    auto best = unseen->end();
    double nearest = kNear2;
    for (auto track = unseen->begin(); track != unseen->end(); ++track) {
      if (!is_alike(track->obstacle.shape, detection.obstacle.shape)) continue;
      const double dt_s = to_seconds(detection.obstacle.utime - track->obstacle.utime);
      const Eigen::Vector3d expected = track->obstacle.position + dt_s * track->obstacle.velocity;
      const double variance = track->covariance.after(std::max(dt_s, 0.0), density()).position +
                              detection.position_var + kNear_m * kNear_m / kNear2;
      const double away = (detection.obstacle.position - expected).squaredNorm() / variance;
      if (away >= nearest) continue;
      nearest = away;
      best = track;
    }
    if (best == unseen->end()) return false;
    correct(detection, utime, &tracks->emplace_back(std::move(*best)));
    unseen->erase(best);
    return true;
  });
}

void Tracker::forget(Utime now, Duration ahead) {
  std::erase_if(tracks_, [&](const Track& track) {
    return check_time(track.last_utime, now, to_duration(config_.timeout_s), ahead) != Refusal::kNone;
  });
}

void Tracker::shift(Duration step) {
  for (Track& track : tracks_) {
    track.obstacle.utime += step;
    track.unbroken_utime += step;
    track.first_utime += step;
    track.last_utime += step;
  }
}

double position_sigma_m(const Track& track, Utime utime) {
  const double dt_s = std::max(0.0, to_seconds(utime - track.obstacle.utime));
  return std::sqrt(track.covariance.after(dt_s, 0.0).position);
}

double velocity_sigma_mps(const Track& track) {
  return std::sqrt(track.covariance.velocity);
}

}  // namespace swarm
