#include "tools/viewer/swarm_picture.h"

#include "lcmtypes/bus/channels.h"
#include "planner_daemon/trajectory/mission.h"
#include "tests/support/column_scan.h"
#include "tests/support/harness.h"
#include "tests/support/random_messages.h"
#include "tools/viewer/picture_frame.h"
#include "tools/viewer/robot_health.h"

namespace swarm::test {
namespace {

using namespace sogm_swarm;

announcement_t announcement(int robot, std::int64_t seq, Utime utime, const Eigen::Vector3d& place,
                            std::int32_t boot = 1) {
  announcement_t message{};
  message.header = make_header(robot, boot, seq, utime);
  message.radius = 0.3f;
  message.committed = Trajectory::hover(static_cast<std::int32_t>(seq) + 1, utime, place).to_wire();
  message.least_delay_us = announcement_t::kUnknown;
  return message;
}

class Picture : public testing::Test {
 protected:
  template <class T>
  Refusal add(const char* channel, const T& message) {
    return picture_.add(now_, channel, encoded_for(channel, message));
  }
  const RobotPicture& robot(int id) const { return picture_.robots().at(id); }

  Utime now_ = kStart;
  SwarmPicture picture_;
};

TEST_F(Picture, KeepsTheNewestOfEachRobot) {
  for (std::int64_t seq = 1; seq <= 5; ++seq, now_ += 20ms) {
    EXPECT_EQ(add(channel::kRobotState, state_at(3, {1.0 * seq, 0, 1}, seq, now_)), Refusal::kNone);
    EXPECT_EQ(add(channel::kRobotState, state_at(4, {-1.0 * seq, 0, 1}, seq, now_)), Refusal::kNone);
  }
  EXPECT_EQ(robot(3).position(now_), Eigen::Vector3d(5, 0, 1));
  EXPECT_EQ(robot(4).position(now_), Eigen::Vector3d(-5, 0, 1));
  // Late and doubled ones change nothing, and are no fault of anybody's.
  EXPECT_EQ(add(channel::kRobotState, state_at(3, {9, 9, 9}, 4, now_)), Refusal::kNone);
  EXPECT_EQ(robot(3).position(now_), Eigen::Vector3d(5, 0, 1));
  EXPECT_EQ(robot(3).traffic.at(channel::kRobotState).heard(), 5);
  EXPECT_EQ(picture_.refused().total(), 0);
  EXPECT_EQ(picture_.messages(), 11);
}

TEST_F(Picture, CountsRatesAgesAndWhatIsMissing) {
  for (std::int64_t seq = 1; seq <= 100; ++seq, now_ += 20ms) {
    if (seq % 10 == 0) continue;
    EXPECT_EQ(add(channel::kAnnouncement, announcement(0, seq, now_, {0, 0, 1})), Refusal::kNone);
  }
  const Traffic& traffic = robot(0).traffic.at(channel::kAnnouncement);
  EXPECT_NEAR(traffic.rate_hz(now_), 45.0, 1.0);
  EXPECT_EQ(traffic.missing(), 9);  // whether the hundredth was sent is not known yet
  EXPECT_NEAR(traffic.age_s(now_), 0.04, 1e-9);
  EXPECT_TRUE(traffic.is_fresh(now_));
  EXPECT_FALSE(traffic.is_fresh(now_ + 2s));
  EXPECT_EQ(traffic.rate_hz(now_ + 2s), 0.0);
  // A new start counts anew.
  EXPECT_EQ(add(channel::kAnnouncement, announcement(0, 0, now_, {0, 0, 1}, 2)), Refusal::kNone);
  EXPECT_EQ(traffic.missing(), 0);
}

TEST_F(Picture, TakesALogThatIsPlayedAgain) {
  add(channel::kRobotState, state_at(0, {5, 0, 1}, 500, now_));
  add(channel::kAnnouncement, announcement(0, 500, now_, {5, 0, 1}));
  now_ += 900ms;
  add(channel::kAnnouncement, announcement(0, 1, kStart, {1, 0, 1}));
  EXPECT_EQ(robot(0).motion.committed.knot(0).position.x(), 5.0) << "late, not again";
  now_ += 600ms;
  add(channel::kRobotState, state_at(0, {1, 0, 1}, 1, now_));
  add(channel::kAnnouncement, announcement(0, 1, now_, {1, 0, 1}));
  EXPECT_EQ(robot(0).motion.committed.knot(0).position.x(), 1.0);
  EXPECT_EQ(robot(0).position(now_), Eigen::Vector3d(1, 0, 1));
  // Or from the middle of a playing log to its beginning.
  now_ = kStart - 60s;
  add(channel::kRobotState, state_at(0, {2, 0, 1}, 0, now_));
  EXPECT_EQ(robot(0).position(now_), Eigen::Vector3d(2, 0, 1));
}

TEST_F(Picture, AnnouncementsCountOnceWhicheverWayTheyCome) {
  const announcement_t message = announcement(2, 7, now_, {1, 2, 3});
  for (const char* channel : {channel::kAnnouncement, channel::kPeerTrajectory, channel::kOwnTrajectory})
    EXPECT_EQ(add(channel, message), Refusal::kNone);
  EXPECT_EQ(robot(2).announcements.heard(), 1);
  EXPECT_EQ(robot(2).traffic.size(), 3u);
  EXPECT_FLOAT_EQ(static_cast<float>(robot(2).radius_m), 0.3f);
  EXPECT_EQ(robot(2).position(now_), Eigen::Vector3d(1, 2, 3)) << "by what it flies";
  add(channel::kRobotState, state_at(2, {1.1, 2, 3}, 1, now_));
  EXPECT_EQ(robot(2).position(now_), Eigen::Vector3d(1.1, 2, 3)) << "by what was measured";
  EXPECT_EQ(robot(2).position(now_ + 700ms), Eigen::Vector3d(1, 2, 3)) << "which is old by now";
}

TEST_F(Picture, RefusesWhatItCannotRead) {
  Bytes damaged = encoded(state_at(0, {0, 0, 1}, 1, now_));
  damaged[50] ^= 1;
  EXPECT_EQ(picture_.add(now_, channel::kRobotState, damaged), Refusal::kCrc);
  EXPECT_EQ(picture_.add(now_, channel::kSogm, damaged), Refusal::kFingerprint);
  EXPECT_EQ(picture_.add(now_, "LCM_SELF_TEST", damaged), Refusal::kNone);
  EXPECT_TRUE(picture_.robots().empty());
  EXPECT_EQ(picture_.refused().total(), 2);
  for (int id = 0; id < 200; ++id) {
    const Refusal expected = id < static_cast<int>(SwarmPicture::kMaxRobots) ? Refusal::kNone : Refusal::kRobot;
    EXPECT_EQ(add(channel::kRobotState, state_at(id, {0, 0, 1}, 1, now_)), expected) << id;
  }
  EXPECT_EQ(picture_.robots().size(), SwarmPicture::kMaxRobots);
}

TEST_F(Picture, ShowsTheWaypointThatIsFlownTo) {
  goal_t goal = to_goal({{{1, 0, 0}}, {{2, 0, 0}}});
  planner_status_t status{};
  const auto next_x = [&](int waypoint, int seq) {
    status.header = make_header(0, 1, seq, now_);
    status.waypoint = waypoint;
    add(channel::kPlannerStatus, status);
    return picture_.robots().at(0).next_goal()->x();
  };
  goal.header = make_header(0, 1, 1, now_);
  add(channel::kGoal, goal);
  EXPECT_EQ(picture_.robots().at(0).next_goal()->x(), 1.0);
  EXPECT_EQ(next_x(1, 1), 2.0);
  EXPECT_EQ(next_x(0, 2), 1.0);
  EXPECT_EQ(next_x(5, 3), 2.0) << "of a longer mission that was not heard";
  status.num_waypoints = 6;
  status.destination[0] = 7.0;
  EXPECT_EQ(next_x(5, 4), 7.0) << "as the planner says";
}

TEST_F(Picture, SurvivesAnyValidMessage) {
  random_messages::Random random(1);
  for (int i = 0; i < 300; ++i, now_ += 1ms) {
    add(channel::kCorridors, random_messages::make<corridors_t>(random, i % 40));
    add(channel::kObstacles, random_messages::make<obstacles_t>(random, i % 40));
    add(channel::kPlannerStatus, random_messages::make<planner_status_t>(random, i % 40));
    add(channel::kBroadcastStatus, random_messages::make<broadcast_status_t>(random, i % 40));
    add(channel::kMapStatus, random_messages::make<map_status_t>(random, i % 40));
    add(channel::kAnnouncement, random_messages::make<announcement_t>(random, i % 40));
    add(channel::kSogm, random_messages::make<sogm_t>(random, i % 40));
    add(channel::kSeenSpace, random_messages::make<sogm_t>(random, i % 40));
    add(channel::kDepthImage, random_messages::make<depth_image_t>(random, i % 40));
    add(channel::kLidarScan, random_messages::make<lidar_scan_t>(random, i % 40));
    add(channel::kFlightStatus, random_messages::make<flight_status_t>(random, i % 40));
    add(channel::kVehicleStatus, random_messages::make<vehicle_status_t>(random, i % 40));
    add(channel::kPerceptionStatus, random_messages::make<perception_status_t>(random, i % 40));
    add(channel::kGoal, random_messages::make<goal_t>(random, i % 40));
  }
  EXPECT_EQ(picture_.robots().size(), SwarmPicture::kMaxRobots);
  FrameWriter writer;
  EXPECT_EQ(robots_json(picture_, now_, &writer).size(), SwarmPicture::kMaxRobots);
  EXPECT_NO_THROW(obstacles_json(picture_, now_, -1));
  for (const auto& [id, robot] : picture_.robots()) {
    EXPECT_NO_THROW(corridors_json(robot, &writer));
    EXPECT_NO_THROW(scans_json(robot, now_, &writer));
  }
}

// What an operator is told of a robot.
TEST_F(Picture, SaysWhatARobotIsAboutAndWhatIsAmiss) {
  std::int64_t seq = 0;
  const auto say = [&](const char* channel, auto message) {
    message.header = make_header(0, 1, seq++, now_);
    ASSERT_EQ(add(channel, message), Refusal::kNone);
  };
  const auto robot = [&]() -> const RobotPicture& { return picture_.robots().at(0); };
  planner_status_t planner{};
  planner.state = planner_status_t::kNoGoal;
  say(channel::kPlannerStatus, planner);
  EXPECT_EQ(activity_of(robot()), "keeps its place");
  EXPECT_EQ(trouble_of(robot(), now_), "no goal");
  planner.state = planner_status_t::kPlanning;
  planner.waypoint = 1, planner.num_waypoints = 3, planner.destination[0] = 2.5;
  say(channel::kPlannerStatus, planner);
  EXPECT_EQ(activity_of(robot()), "flying to [2.5,0,0] (2 of 3)");
  EXPECT_EQ(trouble_of(robot(), now_), "");
  flight_status_t flight{};
  flight.state = flight_status_t::kHome, flight.cause = flight_status_t::kBattery, flight.order_boot = -1;
  say(channel::kFlightStatus, flight);
  EXPECT_EQ(activity_of(robot()), "flying home: the battery is low");
  vehicle_status_t vehicle{};
  vehicle.battery = 0.15f;
  say(channel::kVehicleStatus, vehicle);
  EXPECT_EQ(trouble_of(robot(), now_), "the battery is low");
  broadcast_status_t broadcast{};
  broadcast.state = broadcast_status_t::kWaiting;
  say(channel::kBroadcastStatus, broadcast);
  EXPECT_EQ(trouble_of(robot(), now_), "waiting for a peer");
  planner.state = planner_status_t::kNotLed;
  flight.state = flight_status_t::kOnGround, flight.cause = flight_status_t::kVehicle;
  broadcast.state = broadcast_status_t::kFlying, vehicle.battery = -1.0f;
  say(channel::kPlannerStatus, planner);
  say(channel::kFlightStatus, flight);
  say(channel::kBroadcastStatus, broadcast);
  say(channel::kVehicleStatus, vehicle);
  EXPECT_EQ(activity_of(robot()), "on the ground");
  EXPECT_EQ(trouble_of(robot(), now_), "");
  EXPECT_EQ(trouble_of(robot(), now_ + 3s), "planner daemon silent");
}

TEST_F(Picture, MergesWhatRobotsSayOfObstacles) {
  const auto told = [&](int robot, std::vector<obstacle_t> obstacles, Utime utime) {
    obstacles_t message{};
    message.header = make_header(robot, 1, 1 + (utime - kStart) / 1ms, utime);
    message.num_obstacles = static_cast<std::int32_t>(obstacles.size());
    message.obstacles = std::move(obstacles);
    EXPECT_EQ(add(channel::kObstacles, message), Refusal::kNone);
  };
  obstacle_t column{};
  column.size[0] = 0.5, column.size[1] = 4.0;
  column.velocity[0] = 1.0;
  const auto numbered = [&](int id, double x) {
    obstacle_t one = column;
    one.id = id, one.position[0] = x;
    return one;
  };
  told(0, {numbered(1, 0.0), numbered(2, 10.0)}, kStart);
  told(1, {numbered(2, 20.0), numbered(3, 30.0)}, kStart + 100ms);
  const auto merged = picture_.obstacles(kStart + 300ms);
  ASSERT_EQ(merged.size(), 3u);
  EXPECT_DOUBLE_EQ(merged.at({-1, 1}).position[0], 0.3);
  EXPECT_DOUBLE_EQ(merged.at({-1, 2}).position[0], 20.2) << "by whoever told last";
  EXPECT_DOUBLE_EQ(merged.at({-1, 3}).position[0], 30.2);
  EXPECT_EQ(picture_.obstacles(kStart + 1050ms).size(), 2u);
  EXPECT_TRUE(picture_.obstacles(kStart + 2s).empty());
}

// Each numbers what it sees by itself: the same number is not the same obstacle.
TEST_F(Picture, TellsApartWhatRobotsSeeWithTheirOwnSensors) {
  SogmEncoder encoder;
  Sogm seen;
  seen.reset(GridGeometry{.size = {4, 4, 4}}, 2, kStart, 100ms);
  obstacle_t column{};
  column.id = 7;
  column.size[0] = 0.5, column.size[1] = 4.0;
  for (int id = 0; id < 2; ++id) {
    for (const sogm_t& part : encoder.encode(seen, make_header(id, 1, 1, kStart)))
      EXPECT_EQ(add(channel::kSeenSpace, part), Refusal::kNone);
    obstacles_t message{};
    message.header = make_header(id, 1, 1, kStart);
    column.position[0] = id;
    message.obstacles = {column};
    message.num_obstacles = 1;
    EXPECT_EQ(add(channel::kObstacles, message), Refusal::kNone);
  }
  const auto all = picture_.obstacles(kStart);
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(all.at({1, 7}).position[0], 1.0);
  const auto of_one = picture_.obstacles(kStart, 0);
  ASSERT_EQ(of_one.size(), 1u);
  EXPECT_EQ(of_one.at({0, 7}).position[0], 0.0);
  const Json json = obstacles_json(picture_, kStart, 1);
  ASSERT_EQ(json.size(), 1u);
  EXPECT_EQ(json[0]["id"], "1:7");
}

// Maps and what was seen come as the same messages, on channels of their own.
TEST_F(Picture, KeepsMapsAndWhatWasSeenApart) {
  SogmEncoder encoder;
  Sogm map, seen;
  map.reset(GridGeometry{.size = {4, 4, 4}}, 20, kStart, 100ms);
  seen.reset(GridGeometry{.size = {8, 8, 8}}, 2, kStart, 100ms);
  for (std::int64_t seq = 1; seq <= 3; ++seq) {
    for (const sogm_t& part : encoder.encode(map, make_header(0, 1, seq, now_))) add(channel::kSogm, part);
    for (const sogm_t& part : encoder.encode(seen, make_header(0, 1, 10 + seq, now_))) add(channel::kSeenSpace, part);
  }
  EXPECT_EQ(robot(0).sogm.count(), 3);
  EXPECT_EQ(robot(0).sogm.newest().num_frames, 20);
  EXPECT_EQ(robot(0).seen_space.count(), 3);
  EXPECT_EQ(robot(0).seen_space.newest().num_frames, 2);
}

TEST_F(Picture, KeepsScansOfWhomItLooksAt) {
  lidar_scan_t scan = column_scan({0, 0, 1}, {{{2.0, 0.0}}});
  for (const auto& [maps_of, kept] : {std::pair(0, true), {1, false}, {-1, false}}) {
    picture_ = SwarmPicture(maps_of);
    for (std::int64_t seq = 1; seq <= 2; ++seq) {
      scan.header = make_header(0, 1, seq, kStart);
      EXPECT_EQ(add(channel::kLidarScan, scan), Refusal::kNone);
    }
    EXPECT_EQ(robot(0).scans.count(), kept ? 2 : 0) << maps_of;
  }
}

}  // namespace
}  // namespace swarm::test
