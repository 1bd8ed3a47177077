#include "tools/viewer/swarm_picture.h"

#include "lcmtypes/bus/channels.h"
#include "tests/support/harness.h"
#include "tests/support/random_messages.h"
#include "tools/viewer/picture_frame.h"

namespace swarm::test {
namespace {

using namespace sogm_swarm;

announcement_t announcement(int robot, std::int64_t seq, std::int64_t utime, const Eigen::Vector3d& place,
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
    return picture_.add(now_us_, channel, encoded(message));
  }
  const RobotPicture& robot(int id) const { return picture_.robots().at(id); }

  std::int64_t now_us_ = kStart_us;
  SwarmPicture picture_;
};

TEST_F(Picture, KeepsTheNewestOfEachRobot) {
  for (std::int64_t seq = 1; seq <= 5; ++seq, now_us_ += 20'000) {
    EXPECT_EQ(add(channel::kRobotState, state_at(3, {1.0 * seq, 0, 1}, seq, now_us_)), Refusal::kNone);
    EXPECT_EQ(add(channel::kRobotState, state_at(4, {-1.0 * seq, 0, 1}, seq, now_us_)), Refusal::kNone);
  }
  EXPECT_EQ(robot(3).position(now_us_), Eigen::Vector3d(5, 0, 1));
  EXPECT_EQ(robot(4).position(now_us_), Eigen::Vector3d(-5, 0, 1));
  // Late and doubled ones change nothing, and are no fault of anybody's.
  EXPECT_EQ(add(channel::kRobotState, state_at(3, {9, 9, 9}, 4, now_us_)), Refusal::kNone);
  EXPECT_EQ(robot(3).position(now_us_), Eigen::Vector3d(5, 0, 1));
  EXPECT_EQ(robot(3).traffic.at(channel::kRobotState).heard(), 5);
  EXPECT_EQ(picture_.refused().total(), 0);
  EXPECT_EQ(picture_.messages(), 11);
}

TEST_F(Picture, CountsRatesAgesAndWhatIsMissing) {
  for (std::int64_t seq = 1; seq <= 100; ++seq, now_us_ += 20'000) {
    if (seq % 10 == 0) continue;
    EXPECT_EQ(add(channel::kTrajectory, announcement(0, seq, now_us_, {0, 0, 1})), Refusal::kNone);
  }
  const Traffic& traffic = robot(0).traffic.at(channel::kTrajectory);
  EXPECT_NEAR(traffic.rate_hz(now_us_), 45.0, 1.0);
  EXPECT_EQ(traffic.missing(), 9);  // whether the hundredth was sent is not known yet
  EXPECT_NEAR(traffic.age_s(now_us_), 0.04, 1e-9);
  EXPECT_TRUE(traffic.is_fresh(now_us_));
  EXPECT_FALSE(traffic.is_fresh(now_us_ + 2'000'000));
  EXPECT_EQ(traffic.rate_hz(now_us_ + 2'000'000), 0.0);
  // A new start counts anew.
  EXPECT_EQ(add(channel::kTrajectory, announcement(0, 0, now_us_, {0, 0, 1}, 2)), Refusal::kNone);
  EXPECT_EQ(traffic.missing(), 0);
}

TEST_F(Picture, TakesALogThatIsPlayedAgain) {
  add(channel::kRobotState, state_at(0, {5, 0, 1}, 500, now_us_));
  add(channel::kTrajectory, announcement(0, 500, now_us_, {5, 0, 1}));
  now_us_ += 900'000;
  add(channel::kTrajectory, announcement(0, 1, kStart_us, {1, 0, 1}));
  EXPECT_EQ(robot(0).motion.committed.knot(0).position.x(), 5.0) << "late, not again";
  now_us_ += 600'000;
  add(channel::kRobotState, state_at(0, {1, 0, 1}, 1, now_us_));
  add(channel::kTrajectory, announcement(0, 1, now_us_, {1, 0, 1}));
  EXPECT_EQ(robot(0).motion.committed.knot(0).position.x(), 1.0);
  EXPECT_EQ(robot(0).position(now_us_), Eigen::Vector3d(1, 0, 1));
  // Or from the middle of a playing log to its beginning.
  now_us_ = kStart_us - 60'000'000;
  add(channel::kRobotState, state_at(0, {2, 0, 1}, 0, now_us_));
  EXPECT_EQ(robot(0).position(now_us_), Eigen::Vector3d(2, 0, 1));
}

TEST_F(Picture, AnnouncementsCountOnceWhicheverWayTheyCome) {
  const announcement_t message = announcement(2, 7, now_us_, {1, 2, 3});
  for (const char* channel : {channel::kTrajectory, channel::kPeerTrajectory, channel::kOwnTrajectory})
    EXPECT_EQ(add(channel, message), Refusal::kNone);
  EXPECT_EQ(robot(2).announcements.heard(), 1);
  EXPECT_EQ(robot(2).traffic.size(), 3u);
  EXPECT_FLOAT_EQ(static_cast<float>(robot(2).radius_m), 0.3f);
  EXPECT_EQ(robot(2).position(now_us_), Eigen::Vector3d(1, 2, 3)) << "by what it flies";
  add(channel::kRobotState, state_at(2, {1.1, 2, 3}, 1, now_us_));
  EXPECT_EQ(robot(2).position(now_us_), Eigen::Vector3d(1.1, 2, 3)) << "by what was measured";
  EXPECT_EQ(robot(2).position(now_us_ + 700'000), Eigen::Vector3d(1, 2, 3)) << "which is old by now";
}

TEST_F(Picture, RefusesWhatItCannotRead) {
  Bytes damaged = encoded(state_at(0, {0, 0, 1}, 1, now_us_));
  damaged[50] ^= 1;
  EXPECT_EQ(picture_.add(now_us_, channel::kRobotState, damaged), Refusal::kCrc);
  EXPECT_EQ(picture_.add(now_us_, channel::kSogm, damaged), Refusal::kFingerprint);
  EXPECT_EQ(picture_.add(now_us_, "LCM_SELF_TEST", damaged), Refusal::kNone);
  EXPECT_TRUE(picture_.robots().empty());
  EXPECT_EQ(picture_.refused().total(), 2);
  for (int id = 0; id < 200; ++id) {
    const Refusal expected = id < static_cast<int>(SwarmPicture::kMaxRobots) ? Refusal::kNone : Refusal::kRobot;
    EXPECT_EQ(add(channel::kRobotState, state_at(id, {0, 0, 1}, 1, now_us_)), expected) << id;
  }
  EXPECT_EQ(picture_.robots().size(), SwarmPicture::kMaxRobots);
}

TEST_F(Picture, SurvivesAnyValidMessage) {
  random_messages::Random random(1);
  for (int i = 0; i < 300; ++i, now_us_ += 1000) {
    add(channel::kCorridors, random_messages::make<corridors_t>(random, i % 40));
    add(channel::kObstacles, random_messages::make<obstacles_t>(random, i % 40));
    add(channel::kPlannerStatus, random_messages::make<planner_status_t>(random, i % 40));
    add(channel::kBroadcastStatus, random_messages::make<broadcast_status_t>(random, i % 40));
    add(channel::kMapStatus, random_messages::make<map_status_t>(random, i % 40));
    add(channel::kTrajectory, random_messages::make<announcement_t>(random, i % 40));
    add(channel::kSogm, random_messages::make<sogm_t>(random, i % 40));
    add(channel::kGoal, random_messages::make<goal_t>(random, i % 40));
  }
  EXPECT_EQ(picture_.robots().size(), SwarmPicture::kMaxRobots);
  FrameWriter writer;
  EXPECT_EQ(robots_json(picture_, now_us_, &writer).size(), SwarmPicture::kMaxRobots);
  EXPECT_NO_THROW(obstacles_json(picture_, now_us_));
  for (const auto& [id, robot] : picture_.robots()) EXPECT_NO_THROW(corridors_json(robot, &writer));
}

TEST_F(Picture, MergesWhatRobotsSayOfObstacles) {
  const auto told = [&](int robot, std::vector<obstacle_t> obstacles, std::int64_t utime) {
    obstacles_t message{};
    message.header = make_header(robot, 1, 1 + (utime - kStart_us) / 1000, utime);
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
  told(0, {numbered(1, 0.0), numbered(2, 10.0)}, kStart_us);
  told(1, {numbered(2, 20.0), numbered(3, 30.0)}, kStart_us + 100'000);
  const auto merged = picture_.obstacles(kStart_us + 300'000);
  ASSERT_EQ(merged.size(), 3u);
  EXPECT_DOUBLE_EQ(merged.at(1).position[0], 0.3);
  EXPECT_DOUBLE_EQ(merged.at(2).position[0], 20.2) << "by whoever told last";
  EXPECT_DOUBLE_EQ(merged.at(3).position[0], 30.2);
  EXPECT_EQ(picture_.obstacles(kStart_us + 1'050'000).size(), 2u);
  EXPECT_TRUE(picture_.obstacles(kStart_us + 2'000'000).empty());
}

}  // namespace
}  // namespace swarm::test
