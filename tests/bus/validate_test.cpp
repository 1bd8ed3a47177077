// Every rule about values: a valid message with one field spoilt is refused for the right reason, at the edge of each
// range.
#include "lcmtypes/bus/validate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <type_traits>

#include "tests/support/random_messages.h"

namespace swarm {
namespace {

using namespace random_messages;

constexpr Refusal kGood = Refusal::kNone, kValue = Refusal::kValue, kInconsistent = Refusal::kInconsistent;
constexpr double kPi = std::numbers::pi;

// Every step from a fresh random message.
template <class T>
class Judge {
 public:
  template <class Spoil>
  Refusal operator()(Spoil spoil) {
    T message = make<T>(random_, 3);
    spoil(message);
    return validate(message);
  }

 private:
  Random random_{1};
};

// One number's range: `low` and `high` are taken, the next numbers outside are not.
template <class T, class Access, class Number>
void expect_range(Access access, Number low, Number high, const char* name) {
  Judge<T> judge;
  const auto outside = [](Number bound, int side) {
    if constexpr (std::is_integral_v<Number>)
      return static_cast<Number>(bound + side);
    else
      return std::nextafter(bound, static_cast<Number>(side) * std::numeric_limits<Number>::infinity());
  };
  const auto with = [&](Number value) {
    return judge([&](T& m) { access(m) = static_cast<std::remove_reference_t<decltype(access(m))>>(value); });
  };
  EXPECT_NE(with(low), kValue) << name;
  EXPECT_NE(with(high), kValue) << name;
  EXPECT_EQ(with(outside(low, -1)), kValue) << name;
  EXPECT_EQ(with(outside(high, 1)), kValue) << name;
}
#define EXPECT_RANGE(T, field, low, high) \
  expect_range<T>(                        \
      [](T & m) -> auto& { return m.field; }, low, high, #field)

TEST(Validate, Ranges) {
  EXPECT_RANGE(goal_t, waypoints[2].position[0], -1e5, 1e5);
  EXPECT_RANGE(goal_t, waypoints[1].tolerance, 0.0, 1000.0);
  EXPECT_RANGE(goal_t, waypoints[1].speed, 0.05, 100.0);
  EXPECT_RANGE(goal_t, waypoints[0].wait, 0.0, 86400.0);
  EXPECT_RANGE(robot_state_t, position[0], -1e5, 1e5);
  EXPECT_RANGE(robot_state_t, velocity[1], -100.0, 100.0);
  EXPECT_RANGE(robot_state_t, yaw, -kPi, kPi);
  EXPECT_RANGE(setpoint_t, yaw, -kPi, kPi);
  EXPECT_RANGE(obstacles_t, obstacles[1].position[0], -1e5, 1e5);
  EXPECT_RANGE(obstacles_t, obstacles[1].velocity[2], -100.0, 100.0);
  EXPECT_RANGE(obstacles_t, obstacles[1].yaw, -kPi, kPi);
  EXPECT_RANGE(obstacles_t, obstacles[1].size[0], 0.0, 1000.0);
  EXPECT_RANGE(obstacles_t, obstacles[1].age_s, 0.0, 60.0);
  EXPECT_RANGE(obstacles_t, obstacles[1].position_sigma, 0.0f, 1000.0f);
  EXPECT_RANGE(obstacles_t, obstacles[1].shape, 0, 3);
  EXPECT_RANGE(obstacles_t, complete, 0, 1);
  EXPECT_RANGE(obstacle_voxels_t, position[0], -1e5, 1e5);
  EXPECT_RANGE(obstacle_voxels_t, velocity[0], -100.0, 100.0);
  EXPECT_RANGE(obstacle_voxels_t, age_s, 0.0, 60.0);
  EXPECT_RANGE(obstacle_voxels_t, resolution, 0.01, 1.0);
  EXPECT_RANGE(sogm_t, frame_duration_us, 1, 10'000'000);
  EXPECT_RANGE(sogm_t, num_frames, 1, 128);
  EXPECT_RANGE(sogm_t, size[2], 1, 1024);
  EXPECT_RANGE(sogm_t, origin[1], -(1 << 30), 1 << 30);
  EXPECT_RANGE(sogm_t, resolution, 0.01, 1.0);
  EXPECT_RANGE(sogm_t, num_parts, 1, 64);
  EXPECT_RANGE(sogm_t, total_bytes, 1, 1 << 22);
  EXPECT_RANGE(sogm_t, num_bytes, 1, 60000);
  EXPECT_RANGE(corridors_t, faces[2].piece, 0, 9);
  EXPECT_RANGE(announcement_t, committed.piece_us, 10'000, 10'000'000);
  EXPECT_RANGE(announcement_t, committed.num_pieces, 0, 10);
  EXPECT_RANGE(announcement_t, committed.start_utime, std::int64_t{0}, to_us(kMaxUtime));
  EXPECT_RANGE(announcement_t, committed.knots[0][1], -1e5f, 1e5f);
  EXPECT_RANGE(announcement_t, committed.knots[0][4], -100.0f, 100.0f);
  EXPECT_RANGE(announcement_t, committed.knots[0][8], -1000.0f, 1000.0f);
  EXPECT_RANGE(announcement_t, pending_state, 0, 2);
  EXPECT_RANGE(candidate_t, urgent, 0, 1);
  EXPECT_RANGE(announcement_t, pending_stamp, std::int64_t{0}, to_us(kMaxUtime));
  EXPECT_RANGE(announcement_t, acks[1].verdict, 0, 3);
  EXPECT_RANGE(map_status_t, state, 0, 3);
  EXPECT_RANGE(depth_image_t, sensor, 0, 7);
  EXPECT_RANGE(depth_image_t, position[2], -1e5, 1e5);
  EXPECT_RANGE(depth_image_t, focal_px[1], 1.0f, 1e5f);
  EXPECT_RANGE(depth_image_t, center_px[0], -1e5f, 1e5f);
  EXPECT_RANGE(lidar_scan_t, sensor, 0, 7);
  EXPECT_RANGE(lidar_scan_t, position[0], -1e5, 1e5);
  EXPECT_RANGE(lidar_scan_t, num_parts, 1, 16);
  EXPECT_RANGE(perception_status_t, state, 0, 2);
  EXPECT_RANGE(perception_status_t, map_state, 0, 3);
  EXPECT_RANGE(planner_status_t, state, 0, 6);
  EXPECT_RANGE(order_t, order, 0, 6);
  EXPECT_RANGE(vehicle_status_t, armed, 0, 1);
  EXPECT_RANGE(vehicle_status_t, place, 0, 2);
  EXPECT_RANGE(flight_status_t, state, 0, 6);
  EXPECT_RANGE(flight_status_t, cause, 0, 5);
  EXPECT_RANGE(flight_status_t, led_to, 0, 2);
  EXPECT_RANGE(flight_status_t, destination[1], -1e5, 1e5);
  EXPECT_RANGE(flight_status_t, verdict, 0, 3);
  EXPECT_RANGE(planner_status_t, outcome, 0, 2);
  EXPECT_RANGE(planner_status_t, destination[2], -1e5, 1e5);
  EXPECT_RANGE(broadcast_status_t, state, 0, 6);
  Judge<announcement_t> announcement;
  EXPECT_EQ(announcement([](auto& m) { m.radius = 0.0f; }), kValue);
  EXPECT_EQ(announcement([](auto& m) { m.radius = 10.0f; }), kGood);
  EXPECT_EQ(announcement([](auto& m) { m.radius = 10.01f; }), kValue);
}

TEST(Validate, OrdersAndVehiclesMakeSense) {
  Judge<order_t> order;
  const auto climbs = [&](double height) {
    return order([=](auto& m) { m.order = order_t::kTakeOff, m.height = height; });
  };
  EXPECT_EQ(climbs(0.1), kGood);
  EXPECT_EQ(climbs(100.0), kGood);
  EXPECT_EQ(climbs(0.05), kInconsistent);
  EXPECT_EQ(climbs(100.1), kValue);
  EXPECT_EQ(climbs(std::numeric_limits<double>::quiet_NaN()), kValue);
  EXPECT_EQ(order([](auto& m) { m.order = order_t::kLand, m.height = 1.0; }), kInconsistent);
  EXPECT_EQ(order([](auto& m) { m.order = order_t::kLand, m.other_id = 1; }), kInconsistent);
  const auto without = [&](int robot, int other) {
    return order([=](auto& m) {
      m.order = order_t::kWithout;
      m.height = 0.0;
      m.header.robot_id = static_cast<std::int16_t>(robot);
      m.other_id = static_cast<std::int16_t>(other);
    });
  };
  EXPECT_EQ(without(1, 0), kGood);
  EXPECT_EQ(without(0, 32767), kGood);
  EXPECT_EQ(without(1, 1), kInconsistent);
  EXPECT_EQ(without(1, -1), kValue);
  Judge<vehicle_status_t> vehicle;
  for (const float battery : {-1.0f, 0.0f, 1.0f})
    EXPECT_EQ(vehicle([=](auto& m) { m.battery = battery; }), kGood) << battery;
  for (const float battery : {-0.5f, 1.01f})
    EXPECT_EQ(vehicle([=](auto& m) { m.battery = battery; }), kValue) << battery;
  EXPECT_EQ(vehicle([](auto& m) { m.armed = 0, m.obeys = 1; }), kInconsistent);
  Judge<flight_status_t> status;
  EXPECT_EQ(status([](auto& m) { m.order_boot = -2; }), kValue);
  EXPECT_EQ(status([](auto& m) { m.order_seq = -1; }), kValue);
  EXPECT_EQ(status([](auto& m) { m.climb = -0.1; }), kValue);
}

TEST(Validate, ScansMakeSense) {
  Judge<depth_image_t> image;
  EXPECT_EQ(image([](auto& m) { m.depth_mm[0] = -1; }), kValue);
  EXPECT_EQ(image([](auto& m) { m.orientation[0] = m.orientation[1] = m.orientation[2] = m.orientation[3] = 0.0; }),
            kValue);
  EXPECT_EQ(image([](auto& m) { m.width = static_cast<std::int16_t>(m.num_pixels + 1); }), kInconsistent);
  EXPECT_EQ(image([](auto& m) { m.width = 0; }), kValue);
  Judge<lidar_scan_t> scan;
  EXPECT_EQ(scan([](auto& m) { m.orientation[0] = m.orientation[1] = m.orientation[2] = m.orientation[3] = 0.6; }),
            kValue);
  EXPECT_EQ(scan([](auto& m) { m.part = m.num_parts; }), kInconsistent);
  EXPECT_EQ(scan([](auto& m) { m.part = -1; }), kValue);
  EXPECT_EQ(scan([](auto& m) { m.coordinates.pop_back(), --m.num_coordinates; }), kInconsistent);
  Judge<perception_status_t> status;
  EXPECT_EQ(status([](auto& m) { m.jumps = -1; }), kValue);
  EXPECT_EQ(status([](auto& m) { m.scan_ms = -1.0f; }), kValue);
  EXPECT_EQ(status([](auto& m) { m.refused[4] = -1; }), kValue);
  EXPECT_EQ(status([](auto& m) { m.map_blocks = -1; }), kValue);
  EXPECT_EQ(status([](auto& m) { m.maps_written = -1; }), kValue);
}

TEST(Validate, CountersAndAmountsAreNotNegative) {
  const auto refused = [](auto spoil, auto judge) { return judge(spoil) == kValue; };
  EXPECT_TRUE(refused([](auto& m) { m.id = -1; }, Judge<obstacle_voxels_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.obstacles[2].id = -1; }, Judge<obstacles_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.trajectory_seq = -1; }, Judge<corridors_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.trajectory.seq = -1; }, Judge<candidate_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.acks[0].peer_boot = -2; }, Judge<announcement_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.acks[0].judged_seq = -1; }, Judge<announcement_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.robot_id = -1; }, Judge<last_words_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.boot = -1; }, Judge<last_words_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.seq = -1; }, Judge<last_words_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.utime = -1; }, Judge<last_words_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.part = -1; }, Judge<sogm_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.maps = -1; }, Judge<map_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.map_bytes = -1; }, Judge<map_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.obstacles = -1; }, Judge<map_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.build_ms = -1; }, Judge<map_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.refused[11] = -1; }, Judge<map_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.missed = -1; }, Judge<planner_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.expansions = -1; }, Judge<planner_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.num_waypoints = -1; }, Judge<planner_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.check_ms = -1; }, Judge<planner_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.prepare_ms = -1; }, Judge<planner_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.refused[0] = -1; }, Judge<planner_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.withdrawn = -1; }, Judge<broadcast_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.forced = -1; }, Judge<broadcast_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.forced_seq = -1; }, Judge<announcement_t>()));
  for (const int delay_us : {-10'000'001, 10'000'001, announcement_t::kUnknown - 1})
    EXPECT_TRUE(refused([=](auto& m) { m.least_delay_us = delay_us; }, Judge<announcement_t>())) << delay_us;
  EXPECT_TRUE(refused([](auto& m) { m.rejected[7] = -1; }, Judge<broadcast_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.refused[3] = -1; }, Judge<broadcast_status_t>()));
  EXPECT_TRUE(refused([](auto& m) { m.max_clock_offset_ms = -1; }, Judge<broadcast_status_t>()));
}

TEST(Validate, TrajectoryFieldsAgree) {
  Judge<candidate_t> candidate;
  const auto with = [&](auto spoil) { return candidate([&](candidate_t& m) { spoil(m.trajectory); }); };
  EXPECT_EQ(with([](auto& t) { t.num_pieces = 0; }), kInconsistent);
  EXPECT_EQ(with([](auto& t) { t.seq = 0; }), kInconsistent);
  EXPECT_EQ(with([](auto& t) { t = {}; }), kInconsistent);  // a candidate must propose something
  EXPECT_EQ(candidate([](auto& m) { m.trajectory.start_utime = m.header.utime; }), kGood);
  EXPECT_EQ(candidate([](auto& m) { m.trajectory.start_utime = m.header.utime - 1; }), kInconsistent);
  for (int i = 3; i < 9; ++i) {  // ends at rest
    EXPECT_EQ(with([i](auto& t) { t.knots[t.num_pieces][i] = 0.0009f; }), kGood) << i;
    EXPECT_EQ(with([i](auto& t) { t.knots[t.num_pieces][i] = -0.0011f; }), kInconsistent) << i;
  }
  for (int i = 0; i < 9; ++i) {  // nothing behind the end
    EXPECT_EQ(with([i](auto& t) {
                t.num_pieces = 4;
                std::fill(*t.knots, *std::end(t.knots), 0.0f);
                t.knots[5][i] = 1e-6f;
              }),
              kInconsistent)
        << i;
  }
  Judge<announcement_t> announcement;
  const auto absent = [&](auto spoil) {
    return announcement([&](announcement_t& m) {
      m.pending = {};
      m.pending_state = announcement_t::kNone;
      spoil(m.pending);
    });
  };
  EXPECT_EQ(absent([](auto&) {}), kGood);
  EXPECT_EQ(absent([](auto& t) { t.start_utime = 1; }), kInconsistent);
  EXPECT_EQ(absent([](auto& t) { t.piece_us = 100'000; }), kInconsistent);
  EXPECT_EQ(absent([](auto& t) { t.num_pieces = 1; }), kInconsistent);
  EXPECT_EQ(absent([](auto& t) { t.knots[0][0] = 1.0f; }), kInconsistent);
}

TEST(Validate, AnnouncementFieldsAgree) {
  Judge<announcement_t> judge;
  EXPECT_EQ(judge([](auto& m) { m.committed = {}; }), kInconsistent);  // who has none announces nothing
  for (const std::int8_t state : {announcement_t::kAnnounced, announcement_t::kCommitted}) {
    EXPECT_EQ(judge([state](auto& m) {
                m.pending = {};
                m.pending_state = state;
              }),
              kInconsistent);
    EXPECT_EQ(judge([state](auto& m) {
                m.pending = m.committed;
                m.pending_state = state;
              }),
              kGood);
  }
  EXPECT_EQ(judge([](auto& m) {
              m.pending = m.committed;
              m.pending_state = announcement_t::kNone;
            }),
            kInconsistent);
  EXPECT_EQ(judge([](auto& m) { m.acks[1] = {-1, 0, ack_t::kNone}; }), kGood);  // never heard
  EXPECT_EQ(judge([](auto& m) { m.acks[1] = {-1, 5, ack_t::kAck}; }), kInconsistent);
  for (const std::int8_t verdict : {ack_t::kNone, ack_t::kAck, ack_t::kNack}) {
    for (const std::int32_t seq : {0, 5}) {
      EXPECT_EQ(judge([=](auto& m) {
                  m.acks[1].verdict = verdict;
                  m.acks[1].judged_seq = seq;
                }),
                (verdict == ack_t::kNone) == (seq == 0) ? kGood : kInconsistent);
    }
  }
  for (const std::int32_t seq : {0, 5})  // given up
    EXPECT_EQ(judge([=](auto& m) { m.acks[1] = {3, seq, ack_t::kGivenUp}; }), kGood);
  EXPECT_EQ(judge([](auto& m) { m.acks[1] = {-1, 0, ack_t::kGivenUp}; }), kGood);
  EXPECT_EQ(judge([](auto& m) { m.acks[1] = {-1, 5, ack_t::kGivenUp}; }), kInconsistent);
  EXPECT_EQ(judge([](auto& m) { m.acks[1] = {3, 5, ack_t::kGivenUp + 1}; }), kValue);
}

TEST(Validate, ObstacleSizesBelongToTheShape) {
  Judge<obstacles_t> judge;
  constexpr int kUsed[] = {2, 2, 3, 1};  // column, ring, box, sphere
  for (std::int16_t shape = obstacle_t::kColumn; shape <= obstacle_t::kSphere; ++shape) {
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(judge([=](obstacles_t& m) {
                  m.obstacles[0].shape = shape;
                  std::fill_n(m.obstacles[0].size, 3, 0.0);
                  m.obstacles[0].size[i] = 1.0;
                }),
                i < kUsed[shape] ? kGood : kInconsistent)
          << shape << ' ' << i;
    }
  }
}

TEST(Validate, AGoalHasAWaypoint) {
  Judge<goal_t> judge;
  EXPECT_EQ(judge([](goal_t& m) { m.waypoints.resize(static_cast<std::size_t>(m.num_waypoints = 1)); }), kGood);
  EXPECT_EQ(judge([](goal_t& m) { m.waypoints.resize(static_cast<std::size_t>(m.num_waypoints = 0)); }), kValue);
}

TEST(Validate, CorridorNormalsHaveUnitLength) {
  Judge<corridors_t> judge;
  for (const float scale : {0.0f, 0.9f, 1.1f}) {
    EXPECT_EQ(judge([scale](corridors_t& m) {
                for (float& x : m.faces[1].normal) x *= scale;
              }),
              kValue)
        << scale;
  }
}

TEST(Validate, SogmPartsAndVolumeAgree) {
  Judge<sogm_t> judge;
  const auto parts = [&](int part, int num_parts, int bytes, int total) {
    return judge([=](sogm_t& m) {
      m.part = static_cast<std::int16_t>(part);
      m.num_parts = static_cast<std::int16_t>(num_parts);
      m.num_bytes = bytes;
      m.total_bytes = total;
    });
  };
  EXPECT_EQ(parts(0, 1, 500, 500), kGood);
  EXPECT_EQ(parts(0, 1, 500, 501), kInconsistent);
  EXPECT_EQ(parts(0, 1, 500, 499), kInconsistent);
  EXPECT_EQ(parts(1, 1, 500, 500), kInconsistent);
  EXPECT_EQ(parts(1, 2, 500, 501), kGood);
  EXPECT_EQ(parts(1, 2, 500, 500), kInconsistent);
  EXPECT_EQ(parts(1, 2, 500, 60500), kGood);
  EXPECT_EQ(parts(1, 2, 500, 60501), kInconsistent);
  const auto volume = [&](int frames, int x, int y, int z) {
    return judge([=](sogm_t& m) {
      m.num_frames = static_cast<std::int16_t>(frames);
      m.size[0] = static_cast<std::int16_t>(x);
      m.size[1] = static_cast<std::int16_t>(y);
      m.size[2] = static_cast<std::int16_t>(z);
    });
  };
  EXPECT_EQ(volume(8, 512, 512, 64), kGood);  // 16 MB
  EXPECT_EQ(volume(8, 512, 512, 65), kInconsistent);
  EXPECT_EQ(volume(9, 512, 512, 64), kInconsistent);
  EXPECT_EQ(volume(128, 1024, 1024, 1024), kInconsistent);
  EXPECT_EQ(volume(1, 1024, 256, 64), kGood);
  EXPECT_EQ(volume(1, 1024, 256, 65), kInconsistent);  // a frame of more than 2^24 voxels, 4 MB in all
}

}  // namespace
}  // namespace swarm
