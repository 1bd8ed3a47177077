#include "lcmtypes/bus/validate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>

namespace swarm {

using namespace sogm_swarm;

namespace {

constexpr double kAnything = std::numeric_limits<double>::max();  // but finite
constexpr double kRest = 1e-3;  // what still counts as standing, per axis [m/s], [m/s^2]
constexpr int kMaxDelay_us = 10'000'000;
constexpr double kMaxImage_px = 1e5;

// False for NaN.
bool within(double value, double low, double high) {
  return value >= low && value <= high;
}

template <class Values>
bool all_within(const Values& values, double low, double high) {
  return std::all_of(std::begin(values), std::end(values), [=](double value) { return within(value, low, high); });
}
template <class Values>
bool all_within(const Values& values, double bound) {
  return all_within(values, -bound, bound);
}

bool yaw_ok(double yaw) {
  return within(yaw, -std::numbers::pi, std::numbers::pi);
}
bool orientation_ok(const double (&q)[4]) {
  return within(std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), 0.999, 1.001);
}
bool utime_ok(std::int64_t utime) {
  return utime >= 0 && utime <= to_us(kMaxUtime);
}

// Counters and measured amounts: finite and not negative.
template <class Values>
bool amounts_ok(const Values& values) {
  return all_within(values, 0.0, kAnything);
}

Refusal verdict(bool values_ok, bool consistent = true) {
  if (!values_ok) return Refusal::kValue;
  return consistent ? Refusal::kNone : Refusal::kInconsistent;
}

bool at_zero(const float (&knot)[9]) {
  return all_within(knot, 0.0);
}

Refusal validate(const obstacle_t& m) {
  const int sizes_used = m.shape == obstacle_t::kBox ? 3 : m.shape == obstacle_t::kSphere ? 1 : 2;
  return verdict(m.id >= 0 && within(m.shape, obstacle_t::kColumn, obstacle_t::kSphere) &&
                     all_within(m.position, kMaxPosition_m) && all_within(m.velocity, kMaxVelocity_mps) &&
                     yaw_ok(m.yaw) && all_within(m.size, 0.0, kMaxObstacleSize_m) && within(m.age_s, 0.0, 60.0) &&
                     within(m.position_sigma, 0.0, kMaxObstacleSize_m) &&
                     (m.velocity_sigma == -1.0f || within(m.velocity_sigma, 0.0, kMaxVelocity_mps)),
                 std::all_of(m.size + sizes_used, m.size + 3, [](double size) { return size == 0.0; }));
}

bool waypoint_ok(const waypoint_t& m) {
  return all_within(m.position, kMaxPosition_m) && within(m.tolerance, 0.0, kMaxTolerance_m) &&
         (m.speed == 0.0 || within(m.speed, kLeastSpeed_mps, kMaxVelocity_mps)) && within(m.wait, 0.0, kMaxWait_s);
}

}  // namespace

Refusal validate(const header_t& m) {
  return verdict(m.robot_id >= 0 && m.boot >= 0 && m.seq >= 0 && utime_ok(m.utime));
}

Refusal validate(const trajectory_t& m) {
  if (m.seq == 0) {  // no trajectory: nothing else may be said about it
    return verdict(true, m.start_utime == 0 && m.piece_us == 0 && m.num_pieces == 0 &&
                             std::all_of(std::begin(m.knots), std::end(m.knots), at_zero));
  }
  bool values_ok = m.seq > 0 && utime_ok(m.start_utime) && within(m.piece_us, 10'000, 10'000'000) &&
                   within(m.num_pieces, 0, kMaxTrajectoryPieces);
  for (const auto& knot : m.knots) {
    for (int i = 0; i < 9; ++i) {
      const double bound = i < 3 ? kMaxPosition_m : i < 6 ? kMaxVelocity_mps : kMaxAcceleration_mps2;
      values_ok = values_ok && within(knot[i], -bound, bound);
    }
  }
  if (!values_ok) return Refusal::kValue;
  const auto* const last = m.knots + m.num_pieces;
  const bool at_rest = std::all_of(*last + 3, *last + 9, [](float x) { return within(x, -kRest, kRest); });
  return verdict(true, m.num_pieces > 0 && at_rest && std::all_of(last + 1, std::end(m.knots), at_zero));
}

Refusal validate(const candidate_t& m) {
  if (const Refusal refusal = validate(m.trajectory); refusal != Refusal::kNone) return refusal;
  return verdict(within(m.urgent, 0, 1), m.trajectory.seq > 0 && m.trajectory.start_utime >= m.header.utime);
}

Refusal validate(const announcement_t& m) {
  for (const trajectory_t* trajectory : {&m.committed, &m.pending}) {
    if (const Refusal refusal = validate(*trajectory); refusal != Refusal::kNone) return refusal;
  }
  bool values_ok =
      m.radius > 0.0f && m.radius <= 10.0f && utime_ok(m.pending_stamp) &&
      within(m.pending_state, announcement_t::kNone, announcement_t::kCommitted) && m.forced_seq >= 0 &&
      (m.least_delay_us == announcement_t::kUnknown || within(m.least_delay_us, -kMaxDelay_us, kMaxDelay_us));
  bool consistent = m.committed.seq > 0 && (m.pending.seq == 0) == (m.pending_state == announcement_t::kNone);
  for (const ack_t& ack : m.acks) {
    values_ok =
        values_ok && ack.peer_boot >= -1 && ack.judged_seq >= 0 && within(ack.verdict, ack_t::kNone, ack_t::kGivenUp);
    const bool judges = ack.verdict == ack_t::kAck || ack.verdict == ack_t::kNack;
    consistent = consistent && (ack.verdict == ack_t::kGivenUp || (ack.judged_seq != 0) == judges) &&
                 (ack.peer_boot >= 0 || ack.judged_seq == 0);
  }
  return verdict(values_ok, consistent);
}

Refusal validate(const packed_announcement_t& m) {
  return verdict(m.num_bytes >= 1);
}

Refusal validate(const cell_announcement_t& m) {
  return verdict(m.num_bytes >= 1);
}

Refusal validate(const cell_roster_t& m) {
  return verdict(m.num_bytes >= 1);
}

Refusal validate(const last_words_t& m) {
  return verdict(m.robot_id >= 0 && m.boot >= 0 && m.seq >= 0 && utime_ok(m.utime) && m.num_bytes >= 1);
}

Refusal validate(const corridors_t& m) {
  const auto face_ok = [](const face_t& face) {
    const double norm =
        std::sqrt(face.normal[0] * face.normal[0] + face.normal[1] * face.normal[1] + face.normal[2] * face.normal[2]);
    return within(face.piece, 0, kMaxTrajectoryPieces - 1) && within(norm, 0.999, 1.001) && std::isfinite(face.offset);
  };
  return verdict(m.trajectory_seq >= 0 && std::all_of(m.faces.begin(), m.faces.end(), face_ok));
}

Refusal validate(const goal_t& m) {
  return verdict(m.num_waypoints >= 1 && std::all_of(m.waypoints.begin(), m.waypoints.end(), waypoint_ok));
}

Refusal validate(const order_t& m) {
  const bool climbs = m.order == order_t::kTakeOff;
  const bool names_other = m.order == order_t::kWithout;
  return verdict(
      within(m.order, order_t::kFly, order_t::kWithout) && within(m.height, 0.0, kMaxClimb_m) && m.other_id >= 0,
      (climbs ? m.height >= kLeastClimb_m : m.height == 0.0) &&
          (names_other ? m.other_id != m.header.robot_id : m.other_id == 0));
}

Refusal validate(const vehicle_status_t& m) {
  return verdict(within(m.armed, 0, 1) && within(m.obeys, 0, 1) &&
                     within(m.place, vehicle_status_t::kUnknown, vehicle_status_t::kInAir) &&
                     (m.battery == -1.0f || within(m.battery, 0.0, 1.0)),
                 m.obeys <= m.armed);
}

Refusal validate(const flight_status_t& m) {
  return verdict(within(m.state, flight_status_t::kOnGround, flight_status_t::kEmergency) &&
                 within(m.cause, flight_status_t::kVehicle, flight_status_t::kGaveUp) &&
                 within(m.led_to, flight_status_t::kNowhere, flight_status_t::kDestination) &&
                 all_within(m.destination, kMaxPosition_m) && all_within(m.home, kMaxPosition_m) &&
                 within(m.climb, 0.0, kMaxPosition_m) && m.order_boot >= -1 && m.order_seq >= 0 &&
                 within(m.verdict, flight_status_t::kAccepted, flight_status_t::kNoVehicle));
}

Refusal validate(const robot_state_t& m) {
  return verdict(all_within(m.position, kMaxPosition_m) && all_within(m.velocity, kMaxVelocity_mps) && yaw_ok(m.yaw));
}

Refusal validate(const setpoint_t& m) {
  return verdict(all_within(m.position, kAnything) && all_within(m.velocity, kAnything) &&
                 all_within(m.acceleration, kAnything) && all_within(m.jerk, kAnything) && yaw_ok(m.yaw) &&
                 std::isfinite(m.yaw_rate));
}

Refusal validate(const obstacles_t& m) {
  if (!within(m.complete, 0, 1)) return Refusal::kValue;
  for (const obstacle_t& obstacle : m.obstacles) {
    if (const Refusal refusal = validate(obstacle); refusal != Refusal::kNone) return refusal;
  }
  return Refusal::kNone;
}

Refusal validate(const obstacle_voxels_t& m) {
  return verdict(m.id >= 0 && all_within(m.position, kMaxPosition_m) && all_within(m.velocity, kMaxVelocity_mps) &&
                 within(m.age_s, 0.0, 60.0) && within(m.resolution, 0.01, 1.0));
}

Refusal validate(const depth_image_t& m) {
  return verdict(within(m.sensor, 0, kMaxSensors - 1) && all_within(m.position, kMaxPosition_m) &&
                     orientation_ok(m.orientation) && all_within(m.focal_px, 1.0, kMaxImage_px) &&
                     all_within(m.center_px, kMaxImage_px) && within(m.width, 1, kMaxDepthPixels) &&
                     m.num_pixels >= 1 && all_within(m.depth_mm, 0.0, 32767.0),
                 m.num_pixels % std::max<std::int32_t>(m.width, 1) == 0);
}

Refusal validate(const lidar_scan_t& m) {
  return verdict(within(m.sensor, 0, kMaxSensors - 1) && all_within(m.position, kMaxPosition_m) &&
                     orientation_ok(m.orientation) && m.part >= 0 && within(m.num_parts, 1, kMaxScanParts),
                 m.part < m.num_parts && m.num_coordinates % 3 == 0);
}

Refusal validate(const sogm_t& m) {
  const bool values_ok = within(m.frame_duration_us, 1, 10'000'000) && within(m.num_frames, 1, kMaxMapFrames) &&
                         all_within(m.size, 1, kMaxVoxelsPerAxis) && all_within(m.origin, kMaxWorldIndex) &&
                         within(m.resolution, 0.01, 1.0) && m.part >= 0 && within(m.num_parts, 1, kMaxParts) &&
                         within(m.total_bytes, 1, kMaxCompressedMapBytes) && within(m.num_bytes, 1, kMaxPartBytes);
  if (!values_ok) return Refusal::kValue;
  const std::int64_t words = std::int64_t{m.num_frames} * m.size[0] * m.size[1] * ((m.size[2] + 63) / 64);
  const int others = m.num_parts - 1;  // each holds one byte at least and a full part at most
  const std::int64_t voxels = std::int64_t{m.size[0]} * m.size[1] * m.size[2];
  return verdict(true, voxels <= kMaxVoxelsPerFrame && 8 * words <= kMaxMapBytes && m.part < m.num_parts &&
                           within(m.total_bytes - m.num_bytes, others, others * kMaxPartBytes));
}

Refusal validate(const map_status_t& m) {
  return verdict(within(m.state, map_status_t::kRunning, map_status_t::kBlind) &&
                 amounts_ok(std::array{m.maps, m.map_bytes, m.obstacles}) && amounts_ok(m.refused) &&
                 amounts_ok(std::array{m.rate_hz, m.build_ms}));
}

Refusal validate(const perception_status_t& m) {
  return verdict(within(m.state, perception_status_t::kRunning, perception_status_t::kNoPose) &&
                 within(m.map_state, perception_status_t::kNoMap, perception_status_t::kMapNotWritten) &&
                 amounts_ok(std::array{m.scans, m.points, m.masked, m.moving, m.standing, m.jumps, m.blind,
                                       m.map_blocks, m.maps_written}) &&
                 amounts_ok(m.refused) && amounts_ok(std::array{m.rate_hz, m.scan_ms}));
}

Refusal validate(const map_request_t&) {
  return Refusal::kNone;
}

Refusal validate(const planner_status_t& m) {
  return verdict(within(m.state, planner_status_t::kPlanning, planner_status_t::kNotLed) &&
                 within(m.outcome, planner_status_t::kSmooth, planner_status_t::kUnsafe) &&
                 amounts_ok(std::array{m.plans, m.missed, m.expansions, m.waypoint, m.num_waypoints}) &&
                 all_within(m.destination, kMaxPosition_m) && amounts_ok(m.refused) &&
                 amounts_ok(std::array{m.rate_hz, m.compose_ms, m.search_ms, m.corridor_ms, m.optimize_ms, m.check_ms,
                                       m.total_ms, m.prepare_ms, m.margin}));
}

Refusal validate(const broadcast_status_t& m) {
  return verdict(within(m.state, broadcast_status_t::kFlying, broadcast_status_t::kOffCourse) &&
                 amounts_ok(std::array{m.candidates, m.commits, m.forced, m.withdrawn, m.peers_heard, m.lost}) &&
                 amounts_ok(m.rejected) && amounts_ok(m.refused) &&
                 amounts_ok(std::array{m.max_age_ms, m.max_clock_offset_ms, m.tracking_error, m.error_bound}));
}

}  // namespace swarm
