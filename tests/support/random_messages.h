// Random valid messages of every type, for the tests of the wire.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <type_traits>

#include "lcmtypes/bus/codec.h"
#include "tests/support/start_time.h"

namespace swarm::random_messages {

using namespace sogm_swarm;
using Random = std::mt19937_64;

// For TYPED_TEST_SUITE.
template <class Tuple>
struct TestedTypes;
template <class... T>
struct TestedTypes<std::tuple<T...>> {
  using Types = ::testing::Types<T...>;
};
using AllTypes = TestedTypes<AllMessages>::Types;

inline int integer(Random& random, int low, int high) {
  return std::uniform_int_distribution<int>(low, high)(random);
}
inline double real(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
template <class Real, std::size_t size>
void fill(Random& random, double low, double high, Real (&values)[size]) {
  for (Real& value : values) value = static_cast<Real>(real(random, low, high));
}
template <std::size_t size>
void fill(Random& random, std::int32_t (&counters)[size]) {
  for (std::int32_t& counter : counters) counter = integer(random, 0, 1 << 30);
}

inline header_t make_header(Random& random) {
  header_t header{};
  header.schema_version = header_t::kSchemaVersion;
  header.robot_id = static_cast<std::int16_t>(integer(random, 0, 32767));
  header.boot = integer(random, 0, std::numeric_limits<std::int32_t>::max());
  header.seq = integer(random, 0, 1 << 30);
  header.utime = to_us(kStart) + integer(random, 0, 1 << 30);
  return header;
}

inline trajectory_t make_trajectory(Random& random, std::int64_t utime) {
  trajectory_t t{};
  t.seq = integer(random, 1, 1 << 30);
  t.start_utime = utime + integer(random, 0, 1'000'000);
  t.piece_us = integer(random, 10'000, 10'000'000);
  t.num_pieces = static_cast<std::int16_t>(integer(random, 1, trajectory_t::kMaxPieces));
  for (int k = 0; k <= t.num_pieces; ++k) {
    for (int i = 0; i < 9; ++i) {
      const double bound = i < 3 ? 1e4 : k == t.num_pieces ? 1e-3 : i < 6 ? 99.0 : 900.0;
      t.knots[k][i] = static_cast<float>(0.99 * real(random, -bound, bound));
    }
  }
  return t;
}

// `elements`: of the variable array, if there is one.
inline void make(Random& random, int elements, announcement_t* m) {
  m->radius = static_cast<float>(real(random, 0.1, 10.0));
  m->committed = make_trajectory(random, m->header.utime);
  m->pending_state = static_cast<std::int8_t>(integer(random, announcement_t::kNone, announcement_t::kCommitted));
  m->pending = m->pending_state == 0 ? trajectory_t{} : make_trajectory(random, m->header.utime);
  m->pending_stamp = m->header.utime - 1000;
  m->roster_crc = integer(random, 0, 1 << 30);
  m->forced_seq = integer(random, 0, 1 << 30);
  m->least_delay_us = integer(random, 0, 1) == 0 ? announcement_t::kUnknown : integer(random, -10'000'000, 10'000'000);
  m->num_acks = static_cast<std::int16_t>(std::min(elements, 60));
  m->header.robot_id = 1000;
  for (int i = 0; i < m->num_acks; ++i) {
    ack_t ack{};
    ack.peer_boot = integer(random, 0, 1 << 30);
    ack.verdict = static_cast<std::int8_t>(integer(random, ack_t::kNone, ack_t::kGivenUp));
    ack.judged_seq = ack.verdict == ack_t::kNone ? 0 : integer(random, 1, 1 << 30);
    m->acks.push_back(ack);
  }
}
// Bytes that say nothing: what is packed is for packed_announcement_test and packed_cell_messages_test.
template <class Packed>
void fill_packed(Random& random, int elements, Packed* m) {
  m->num_bytes = static_cast<std::int16_t>(std::clamp(elements, 1, kMaxPackedBytes));
  m->packed.resize(static_cast<std::size_t>(m->num_bytes));
  for (std::uint8_t& byte : m->packed) byte = static_cast<std::uint8_t>(random());
}
inline void make(Random& random, int elements, packed_announcement_t* m) {
  fill_packed(random, elements, m);
}
inline void make(Random& random, int elements, cell_announcement_t* m) {
  fill_packed(random, elements, m);
}
inline void make(Random& random, int elements, cell_roster_t* m) {
  fill_packed(random, elements, m);
}
inline void make(Random& random, int elements, last_words_t* m) {
  m->robot_id = static_cast<std::int16_t>(integer(random, 0, 32767));
  m->boot = integer(random, 0, 1 << 30);
  m->seq = integer(random, 0, 1 << 30);
  m->utime = m->header.utime - 5'000'000;
  m->num_bytes = static_cast<std::int16_t>(std::clamp(elements, 1, kMaxPackedBytes));
  m->packed.resize(static_cast<std::size_t>(m->num_bytes));
  for (std::uint8_t& byte : m->packed) byte = static_cast<std::uint8_t>(random());
}
inline void make(Random& random, int, broadcast_status_t* m) {
  m->state = static_cast<std::int16_t>(integer(random, 0, 4));
  m->candidates = m->commits = m->forced = m->withdrawn = m->peers_heard = m->lost = integer(random, 0, 1 << 30);
  fill(random, m->rejected);
  fill(random, m->refused);
  m->max_age_ms = m->max_clock_offset_ms = static_cast<float>(real(random, 0, 1e3));
}
inline void make(Random& random, int, candidate_t* m) {
  m->trajectory = make_trajectory(random, m->header.utime);
}
inline void make(Random& random, int elements, corridors_t* m) {
  m->trajectory_seq = integer(random, 0, 1 << 30);
  m->num_faces = std::min(elements, 2048);
  for (int i = 0; i < m->num_faces; ++i) {
    face_t face{};
    face.piece = static_cast<std::int16_t>(integer(random, 0, trajectory_t::kMaxPieces - 1));
    const double angle = real(random, -3.0, 3.0);
    face.normal[i % 3] = static_cast<float>(std::sin(angle));
    face.normal[(i + 1) % 3] = static_cast<float>(std::cos(angle));
    face.offset = static_cast<float>(real(random, -50, 50));
    m->faces.push_back(face);
  }
}
inline void make_pose(Random& random, double (&position)[3], double (&orientation)[4]) {
  fill(random, -1e5, 1e5, position);
  const double angle = real(random, -3.0, 3.0);
  orientation[0] = std::cos(angle), orientation[integer(random, 1, 3)] = std::sin(angle);
}
inline void make(Random& random, int elements, depth_image_t* m) {
  m->sensor = static_cast<std::int16_t>(integer(random, 0, 7));
  make_pose(random, m->position, m->orientation);
  fill(random, 1, 1e5, m->focal_px);
  fill(random, -1e5, 1e5, m->center_px);
  m->num_pixels = std::clamp(elements, 1, 32000);
  m->width = static_cast<std::int16_t>(m->num_pixels % 2 == 0 ? m->num_pixels / 2 : 1);
  for (int i = 0; i < m->num_pixels; ++i) m->depth_mm.push_back(static_cast<std::int16_t>(integer(random, 0, 32767)));
}
inline void make(Random& random, int elements, lidar_scan_t* m) {
  m->sensor = static_cast<std::int16_t>(integer(random, 0, 7));
  make_pose(random, m->position, m->orientation);
  m->num_parts = static_cast<std::int16_t>(integer(random, 1, 16));
  m->part = static_cast<std::int16_t>(integer(random, 0, m->num_parts - 1));
  m->num_coordinates = 3 * (std::min(elements, 30000) / 3);
  for (int i = 0; i < m->num_coordinates; ++i)
    m->coordinates.push_back(static_cast<std::int16_t>(integer(random, -32768, 32767)));
}
inline void make(Random& random, int, perception_status_t* m) {
  m->state = static_cast<std::int16_t>(integer(random, 0, 2));
  m->scans = m->points = m->masked = m->moving = m->standing = m->jumps = m->blind = integer(random, 0, 1 << 22);
  m->rate_hz = m->scan_ms = static_cast<float>(real(random, 0, 1e3));
  m->map_state = static_cast<std::int16_t>(integer(random, 0, 3));
  m->map_blocks = m->maps_written = integer(random, 0, 1 << 15);
  fill(random, m->refused);
}
inline void make(Random&, int, map_request_t*) {}
inline void make(Random& random, int elements, goal_t* m) {
  m->num_waypoints = std::clamp(elements, 1, 1000);
  m->waypoints.resize(static_cast<std::size_t>(m->num_waypoints));
  for (waypoint_t& waypoint : m->waypoints) {
    fill(random, -1e5, 1e5, waypoint.position);
    waypoint.tolerance = real(random, 0, 1000);
    waypoint.speed = integer(random, 0, 1) == 0 ? 0.0 : real(random, 0.05, 100);
    waypoint.wait = real(random, 0, 86400);
  }
}
inline void make(Random& random, int, order_t* m) {
  m->order = static_cast<std::int16_t>(integer(random, 0, 6));
  if (m->order == order_t::kWithout)
    m->other_id = static_cast<std::int16_t>(m->header.robot_id > 0 ? m->header.robot_id - 1 : 1);
  m->height = m->order == order_t::kTakeOff ? real(random, 0.1, 100) : 0.0;
}
inline void make(Random& random, int, vehicle_status_t* m) {
  m->armed = static_cast<std::int16_t>(integer(random, 0, 1));
  m->obeys = static_cast<std::int16_t>(m->armed * integer(random, 0, 1));
  m->place = static_cast<std::int16_t>(integer(random, 0, 2));
  m->battery = integer(random, 0, 3) == 0 ? -1.0f : static_cast<float>(real(random, 0, 1));
}
inline void make(Random& random, int, flight_status_t* m) {
  m->state = static_cast<std::int16_t>(integer(random, 0, 6));
  m->cause = static_cast<std::int16_t>(integer(random, 0, 5));
  m->led_to = static_cast<std::int16_t>(integer(random, 0, 2));
  fill(random, -1e5, 1e5, m->destination);
  fill(random, -1e5, 1e5, m->home);
  m->climb = real(random, 0, 100);
  m->order_boot = integer(random, -1, 1 << 30);
  m->order_seq = integer(random, 0, 1 << 30);
  m->verdict = static_cast<std::int16_t>(integer(random, 0, 3));
}
inline void make(Random& random, int, map_status_t* m) {
  m->state = static_cast<std::int16_t>(integer(random, 0, 2));
  m->maps = m->map_bytes = m->obstacles = integer(random, 0, 1 << 22);
  m->rate_hz = m->build_ms = static_cast<float>(real(random, 0, 1e3));
  fill(random, m->refused);
}
inline void make(Random& random, int elements, obstacle_voxels_t* m) {
  m->id = integer(random, 0, 1 << 30);
  fill(random, -1e5, 1e5, m->position);
  fill(random, -100, 100, m->velocity);
  m->age_s = real(random, 0, 60);
  m->resolution = real(random, 0.01, 1.0);
  m->num_voxels = elements;
  for (int i = 0; i < elements; ++i) {
    m->voxels.push_back({static_cast<std::int16_t>(integer(random, -32768, 32767)), 7, -7});
  }
}
inline void make(Random& random, int elements, obstacles_t* m) {
  m->complete = integer(random, 0, 1) == 1;
  m->num_obstacles = std::min(elements, 4096);
  for (int i = 0; i < m->num_obstacles; ++i) {
    obstacle_t o{};
    o.id = i;
    o.shape = static_cast<std::int16_t>(integer(random, obstacle_t::kColumn, obstacle_t::kSphere));
    fill(random, -1e5, 1e5, o.position);
    fill(random, -100, 100, o.velocity);
    o.yaw = real(random, -3.14, 3.14);
    fill(random, 0, 1000, o.size);
    if (o.shape != obstacle_t::kBox) o.size[2] = 0.0;
    if (o.shape == obstacle_t::kSphere) o.size[1] = 0.0;
    o.age_s = real(random, 0, 60);
    o.position_sigma = static_cast<float>(real(random, 0, 1000));
    o.velocity_sigma = i % 3 == 0 ? -1.0f : static_cast<float>(real(random, 0, 100));
    m->obstacles.push_back(o);
  }
}
inline void make(Random& random, int, planner_status_t* m) {
  m->state = static_cast<std::int16_t>(integer(random, 0, 5));
  m->outcome = static_cast<std::int16_t>(integer(random, 0, 2));
  m->plans = m->missed = m->expansions = m->waypoint = m->num_waypoints = integer(random, 0, 1 << 30);
  fill(random, -1e5, 1e5, m->destination);
  for (float* value : {&m->rate_hz, &m->compose_ms, &m->search_ms, &m->corridor_ms, &m->optimize_ms, &m->check_ms,
                       &m->total_ms, &m->prepare_ms}) {
    *value = static_cast<float>(real(random, 0, 1e3));
  }
  fill(random, m->refused);
}
inline void make(Random& random, int, robot_state_t* m) {
  fill(random, -1e5, 1e5, m->position);
  fill(random, -100, 100, m->velocity);
  m->yaw = real(random, -3.14, 3.14);
}
inline void make(Random& random, int, setpoint_t* m) {
  for (auto* values : {&m->position, &m->velocity, &m->acceleration, &m->jerk}) fill(random, -50, 50, *values);
  m->yaw = real(random, -3.14, 3.14);
  m->yaw_rate = real(random, -50, 50);
}
inline void make(Random& random, int elements, sogm_t* m) {
  m->frame_duration_us = integer(random, 1, 10'000'000);
  m->num_frames = static_cast<std::int16_t>(integer(random, 1, 128));
  for (std::int16_t& size : m->size) size = static_cast<std::int16_t>(integer(random, 1, 128));
  for (std::int32_t& origin : m->origin) origin = integer(random, -(1 << 30), 1 << 30);
  m->resolution = real(random, 0.01, 1.0);
  m->num_parts = static_cast<std::int16_t>(integer(random, 1, 64));
  m->part = static_cast<std::int16_t>(integer(random, 0, m->num_parts - 1));
  m->num_bytes = std::clamp(elements, 1, 60000);
  m->total_bytes = m->num_bytes + (m->num_parts - 1) * integer(random, 1, 60000);
  m->packed.resize(static_cast<std::size_t>(m->num_bytes));
  for (std::uint8_t& byte : m->packed) byte = static_cast<std::uint8_t>(random());
}

// A message with `elements` in its variable array, or the nearest number that is allowed.
template <class T>
T make(Random& random, int elements) {
  T message{};
  message.header = make_header(random);
  make(random, elements, &message);
  return message;
}

// Calls f with every floating-point number of a message.
template <class F, class... Values>
void each(F f, Values&... values) {
  const auto one = [&f](auto& value) {
    if constexpr (std::is_array_v<std::remove_reference_t<decltype(value)>>) {
      for (auto& element : value) each(f, element);
    } else {
      f(value);
    }
  };
  (one(values), ...);
}
template <class F>
void each_real(announcement_t& m, F f) {
  each(f, m.radius, m.committed.knots, m.pending.knots);
}
template <class F>
void each_real(broadcast_status_t& m, F f) {
  each(f, m.max_age_ms, m.max_clock_offset_ms);
}
template <class F>
void each_real(candidate_t& m, F f) {
  each(f, m.trajectory.knots);
}
template <class F>
void each_real(corridors_t& m, F f) {
  for (face_t& face : m.faces) each(f, face.normal, face.offset);
}
template <class F>
void each_real(depth_image_t& m, F f) {
  each(f, m.position, m.orientation, m.focal_px, m.center_px);
}
template <class F>
void each_real(lidar_scan_t& m, F f) {
  each(f, m.position, m.orientation);
}
template <class F>
void each_real(perception_status_t& m, F f) {
  each(f, m.rate_hz, m.scan_ms);
}
template <class F>
void each_real(map_request_t&, F) {}
template <class F>
void each_real(packed_announcement_t&, F) {}
template <class F>
void each_real(last_words_t&, F) {}
template <class F>
void each_real(cell_announcement_t&, F) {}
template <class F>
void each_real(cell_roster_t&, F) {}
template <class F>
void each_real(goal_t& m, F f) {
  for (waypoint_t& w : m.waypoints) each(f, w.position, w.tolerance, w.speed, w.wait);
}
template <class F>
void each_real(order_t& m, F f) {
  each(f, m.height);
}
template <class F>
void each_real(vehicle_status_t& m, F f) {
  each(f, m.battery);
}
template <class F>
void each_real(flight_status_t& m, F f) {
  each(f, m.destination, m.home, m.climb);
}
template <class F>
void each_real(map_status_t& m, F f) {
  each(f, m.rate_hz, m.build_ms);
}
template <class F>
void each_real(obstacle_voxels_t& m, F f) {
  each(f, m.position, m.velocity, m.age_s, m.resolution);
}
template <class F>
void each_real(obstacles_t& m, F f) {
  for (obstacle_t& o : m.obstacles)
    each(f, o.position, o.velocity, o.yaw, o.size, o.age_s, o.position_sigma, o.velocity_sigma);
}
template <class F>
void each_real(planner_status_t& m, F f) {
  each(f, m.rate_hz, m.compose_ms, m.search_ms, m.corridor_ms, m.optimize_ms, m.check_ms, m.total_ms, m.prepare_ms,
       m.destination);
}
template <class F>
void each_real(robot_state_t& m, F f) {
  each(f, m.position, m.velocity, m.yaw);
}
template <class F>
void each_real(setpoint_t& m, F f) {
  each(f, m.position, m.velocity, m.acceleration, m.jerk, m.yaw, m.yaw_rate);
}
template <class F>
void each_real(sogm_t& m, F f) {
  each(f, m.resolution);
}

}  // namespace swarm::random_messages
