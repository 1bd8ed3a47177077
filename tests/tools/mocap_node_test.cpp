// Motion capture to states and obstacles, in simulated time.
#include "tools/bridge/mocap_node.h"

#include <nlohmann/json.hpp>
#include <numbers>

#include "lcmtypes/bus/channels.h"
#include "tests/support/harness.h"
#include "tests/support/random_motion.h"
#include "tools/bridge/mocap_log.h"

namespace swarm::test {
namespace {

using nlohmann::json;
using sogm_swarm::obstacle_t;
using sogm_swarm::obstacles_t;
using sogm_swarm::robot_state_t;

MocapConfig make_config() {
  MocapConfig config;
  config.robot_id = 3;
  config.body = "robot3";
  config.obstacles = "person*:column:0.6,1.9:0,0,-0.8;door:box:0.9,0.05,2:0.45,0,0";
  return config;
}

json make_body(const std::string& name, const Eigen::Vector3d& position, double yaw = 0.0) {
  return {{"name", name},
          {"position", {position.x(), position.y(), position.z()}},
          {"quaternion", {std::cos(yaw / 2), 0, 0, std::sin(yaw / 2)}}};
}

struct Capture : Bench<MocapNode> {
  explicit Capture(const MocapConfig& config = make_config()) : Bench(config, 1'700'000'000) {}

  void hear(const std::string& text) {
    node.on_datagram(now, std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()), out);
    step();
  }
  void hear(const json& t, const json& bodies) { hear(json{{"t", t}, {"bodies", bodies}}.dump()); }
  // Of these bodies at 100 Hz.
  void watch(double seconds, const std::function<json(double t_s)>& bodies, bool with_time = true) {
    for (int i = 0; i < std::lround(100 * seconds); ++i) {
      t_s += 0.01;
      hear(with_time ? json(t_s) : json(), bodies(t_s));
      run_for(0.01);
    }
  }
  obstacles_t obstacles() const { return out.newest<obstacles_t>(channel::kObstacles); }
  std::int64_t refused(MocapRefusal reason) const { return node.report().refused[static_cast<std::size_t>(reason)]; }

  double t_s = 5.0;
};

TEST(Mocap, TellsWhereTheRobotIsAndHowItMoves) {
  for (const bool with_time : {true, false}) {
    MocapConfig config = make_config();
    config.delay_s = 0.015;
    Capture capture(config);
    const Eigen::Vector3d start(1, 2, 3), velocity(0.5, -1.5, 0.25);
    capture.watch(
        1.0, [&](double t_s) { return json::array({make_body("robot3", start + t_s * velocity, -2.0)}); }, with_time);
    const auto state = capture.out.newest<robot_state_t>(channel::kRobotState);
    EXPECT_EQ(capture.out.count(channel::kRobotState), 100);
    EXPECT_EQ(state.header.robot_id, 3);
    EXPECT_EQ(to_utime(state.header.utime), capture.now - 10ms - 15ms);
    EXPECT_LT((Eigen::Vector3d(state.position) - (start + capture.t_s * velocity)).norm(), 1e-9);
    EXPECT_LT((Eigen::Vector3d(state.velocity) - velocity).norm(), 1e-5);
    EXPECT_NEAR(state.yaw, -2.0, 1e-12);
    EXPECT_EQ(capture.obstacles().num_obstacles, 0);
  }
}

TEST(Mocap, VelocityIsTheSlopeOfTheLastFifthOfASecond) {
  Rng rng(1);
  std::normal_distribution<double> noise(0.0, 0.001);
  Capture capture;
  double worst = 0.0;
  for (int i = 0; i < 200; ++i) {
    const double before = capture.t_s;
    capture.watch(0.01, [&](double t_s) {
      const Eigen::Vector3d error(noise(rng), noise(rng), noise(rng));
      return json::array({make_body("robot3", Eigen::Vector3d(0.8 * t_s, 0, 1) + error)});
    });
    ASSERT_GT(capture.t_s, before);
    if (i < 20) continue;
    const auto state = capture.out.newest<robot_state_t>(channel::kRobotState);
    worst = std::max(worst, (Eigen::Vector3d(state.velocity) - Eigen::Vector3d(0.8, 0, 0)).norm());
  }
  EXPECT_LT(worst, 0.02);  // single differences are wrong by some 0.2 m/s
  EXPECT_GT(worst, 0.001);

  // A turn is noticed within the window, and forgotten after it.
  capture.watch(0.25, [](double t_s) { return json::array({make_body("robot3", {10 - t_s, 0, 1})}); });
  const auto state = capture.out.newest<robot_state_t>(channel::kRobotState);
  EXPECT_LT((Eigen::Vector3d(state.velocity) - Eigen::Vector3d(-1, 0, 0)).norm(), 1e-6);
}

TEST(Mocap, BodiesBecomeObstaclesByTheirRules) {
  Capture capture;
  capture.watch(0.5, [](double t_s) {
    return json::array({make_body("person1", {t_s, 0, 1.75}), make_body("person2", {4, 4, 1.75}),
                        make_body("door", {1, 1, 1}, std::numbers::pi / 2), make_body("robot0", {9, 9, 1}),
                        make_body("persona", {0, -t_s, 1.75}), make_body("robot3", {0, 0, 1})});
  });
  const obstacles_t message = capture.obstacles();
  ASSERT_EQ(message.num_obstacles, 4);
  std::map<std::int32_t, obstacle_t> by_id;
  for (const obstacle_t& obstacle : message.obstacles) by_id[obstacle.id] = obstacle;
  ASSERT_EQ(by_id.size(), 4u);
  int moving = 0, doors = 0;
  for (const auto& [id, obstacle] : by_id) {
    EXPECT_EQ(obstacle.age_s, 0.0);
    if (Eigen::Vector3d(obstacle.velocity).norm() > 0.5) ++moving;
    if (obstacle.shape == obstacle_t::kBox) {
      ++doors;
      EXPECT_LT((Eigen::Vector3d(obstacle.position) - Eigen::Vector3d(1, 1.45, 1)).norm(), 1e-9);  // hung at its edge
      EXPECT_EQ(Eigen::Vector3d(obstacle.size), Eigen::Vector3d(0.9, 0.05, 2));
      EXPECT_NEAR(obstacle.yaw, std::numbers::pi / 2, 1e-9);
    } else {
      EXPECT_EQ(obstacle.shape, obstacle_t::kColumn);
      EXPECT_EQ(Eigen::Vector3d(obstacle.size), Eigen::Vector3d(0.6, 1.9, 0));
      EXPECT_NEAR(obstacle.position[2], 0.95, 1e-9);
    }
  }
  EXPECT_EQ(moving, 2);
  EXPECT_EQ(doors, 1);
  EXPECT_EQ(capture.node.report().passed_over, 50);
  EXPECT_NEAR(capture.out.count(channel::kObstacles), 13, 4);  // not at 100 Hz

  MocapConfig config = make_config();
  config.obstacles = "";
  Capture without(config);
  without.watch(0.5, [](double) { return json::array({make_body("person1", {1, 1, 1})}); });
  EXPECT_EQ(without.out.letters.size(), 0u);
}

TEST(Mocap, WhatIsNotSeenForHalfASecondIsGone) {
  Capture capture;
  const auto both = [](double) {
    return json::array({make_body("person1", {1, 1, 1}), make_body("person2", {2, 2, 1})});
  };
  capture.watch(0.3, both);
  EXPECT_EQ(capture.obstacles().num_obstacles, 2);
  const auto one = [](double) { return json::array({make_body("person2", {2, 2, 1})}); };
  capture.watch(0.45, one);
  ASSERT_EQ(capture.obstacles().num_obstacles, 2);
  double oldest = 0.0;
  for (const obstacle_t& obstacle : capture.obstacles().obstacles) oldest = std::max(oldest, obstacle.age_s);
  EXPECT_NEAR(oldest, 0.43, 0.04);
  capture.watch(0.1, one);
  EXPECT_EQ(capture.obstacles().num_obstacles, 1);
  // Where motion capture itself is gone, nothing is said.
  const std::size_t letters = capture.out.letters.size();
  capture.run_for(5.0);
  EXPECT_EQ(capture.out.letters.size(), letters);
}

TEST(Mocap, WhatJumpsBeginsAnew) {
  Capture capture;
  capture.watch(0.5, [](double) { return json::array({make_body("robot3", {0, 0, 1})}); });
  capture.watch(0.02, [](double) { return json::array({make_body("robot3", {50, 0, 1})}); });
  EXPECT_EQ(capture.node.report().jumps, 1);
  const auto state = capture.out.newest<robot_state_t>(channel::kRobotState);
  EXPECT_EQ(state.position[0], 50);
  EXPECT_EQ(state.velocity[0], 0);
}

TEST(Mocap, FollowsTheClockOfMotionCapture) {
  Capture capture;
  const json bodies = json::array({make_body("robot3", {0, 0, 1})});
  const auto states = [&] { return capture.out.count(channel::kRobotState); };
  capture.hear(100.0, bodies);
  capture.hear(100.0, bodies);
  capture.hear(99.5, bodies);
  EXPECT_EQ(capture.refused(MocapRefusal::kOld), 2);
  EXPECT_EQ(states(), 1);
  capture.hear(100.01, bodies);
  capture.hear(0.01, bodies);  // it began anew
  capture.hear(0.02, bodies);
  capture.hear(nullptr, bodies);
  capture.hear(nullptr, bodies);
  capture.hear(0.01, bodies);
  EXPECT_EQ(states(), 7);

  // Obstacles stay where they were until they are gone, without a velocity.
  Capture restarted;
  restarted.watch(0.3, [](double t_s) { return json::array({make_body("person1", {t_s, 1, 1})}); });
  restarted.hear(0.01, json::array());
  restarted.run_for(0.05);
  restarted.hear(0.06, json::array());
  const obstacles_t message = restarted.obstacles();
  ASSERT_EQ(message.num_obstacles, 1);
  EXPECT_NEAR(message.obstacles[0].position[0], restarted.t_s, 1e-9);
  EXPECT_EQ(message.obstacles[0].velocity[0], 0.0);
  EXPECT_EQ(capture.refused(MocapRefusal::kOld), 2);
}

TEST(Mocap, RefusesWhateverElseWithWords) {
  Capture capture;
  const auto expect_refused = [&](const std::string& text, MocapRefusal reason, const std::string& words) {
    const std::int64_t before = capture.refused(reason);
    capture.hear(text);
    EXPECT_EQ(capture.refused(reason), before + 1) << text << "\n" << capture.node.report().words;
    EXPECT_EQ(capture.node.report().words, words) << text;
  };
  const std::string not_json = "the datagram is not one JSON object";
  for (const char* text : {"", "{", "[]", "1", "nonsense", R"({"t": NaN, "bodies": []})",
                           R"({"t": 1e999, "bodies": []})", R"({"t": 1, "bodies": []} x)", "\xff\xfe",
                           R"({"t": 1, "bodies": [{"name": ")"
                           "\xff"
                           R"("}]})"})
    expect_refused(text, MocapRefusal::kJson, not_json);
  expect_refused(std::string(60'000, '['), MocapRefusal::kJson, not_json);
  std::string deep = R"({"t": 1, "bodies": )" + std::string(20'000, '[') + std::string(20'000, ']') + "}";
  expect_refused(deep, MocapRefusal::kFields, "bodies[0]: must be an object");
  expect_refused("{}", MocapRefusal::kFields, "the datagram: has no \"t\"");
  expect_refused(R"({"t": "1", "bodies": []})", MocapRefusal::kFields, "t: must be a number of seconds or null");
  expect_refused(R"({"t": 1e12, "bodies": []})", MocapRefusal::kValue, "t: out of range");
  expect_refused(R"({"t": 1})", MocapRefusal::kFields, "the datagram: has no \"bodies\"");
  expect_refused(R"({"t": 1, "bodies": {}})", MocapRefusal::kFields, "bodies: must be an array");
  const auto with = [](const char* key, const json& value) {
    json body = make_body("person1", {1, 2, 3});
    body[key] = value;
    return json{{"t", 1}, {"bodies", json::array({make_body("person0", {1, 2, 3}), body})}}.dump();
  };
  expect_refused(with("name", 1), MocapRefusal::kFields, "bodies[1].name: must be text");
  expect_refused(with("name", ""), MocapRefusal::kValue, "bodies[1].name: must have 1 to 64 bytes");
  expect_refused(with("name", std::string(65, 'a')), MocapRefusal::kValue, "bodies[1].name: must have 1 to 64 bytes");
  expect_refused(with("name", "person0"), MocapRefusal::kTwice, "bodies[1].name: is there twice");
  for (const json& position : {json(1), json::array({1, 2}), json::array({1, 2, 3, 4}), json::array({1, 2, "3"}),
                               json::array({1, 2, nullptr})})
    expect_refused(with("position", position), MocapRefusal::kFields, "bodies[1].position: must be 3 numbers");
  expect_refused(with("position", {1, 2, 1e5}), MocapRefusal::kValue, "bodies[1].position: out of range");
  expect_refused(with("quaternion", {1, 0, 0}), MocapRefusal::kFields, "bodies[1].quaternion: must be 4 numbers");
  expect_refused(with("quaternion", {0, 0, 0, 0}), MocapRefusal::kValue, "bodies[1].quaternion: must have length 1");
  expect_refused(with("quaternion", {1e9, 0, 0, 0}), MocapRefusal::kValue, "bodies[1].quaternion: out of range");
  json many = json::array();
  for (int i = 0; i < 1025; ++i) many.push_back(1);
  expect_refused(json{{"t", 1}, {"bodies", many}}.dump(), MocapRefusal::kValue, "bodies: more than 1024");
  EXPECT_TRUE(capture.out.letters.empty());
  EXPECT_EQ(capture.node.report().datagrams, 0);
}

TEST(Mocap, SurvivesAnyBytes) {
  Rng rng(2);
  Capture capture;
  const std::string good =
      json{{"t", 1e6}, {"bodies", json::array({make_body("robot3", {1, 2, 3}), make_body("person1", {4, 5, 6})})}}
          .dump();
  for (int i = 0; i < 20'000; ++i) {
    std::string text = good;
    for (int k = uniform_int(rng, 1, 4); k > 0; --k) {
      const auto at = static_cast<std::size_t>(uniform_int(rng, 0, static_cast<int>(text.size()) - 1));
      const char common[] = "[]{},:\"0123456789.-eE ";
      text[at] = uniform_int(rng, 0, 1) == 0 ? common[uniform_int(rng, 0, 21)] : static_cast<char>(rng());
    }
    capture.hear(text);
    for (const auto& letter : capture.out.letters) {  // whatever is said can be heard
      robot_state_t state;
      obstacles_t obstacles;
      const Refusal refusal =
          letter.channel == channel::kRobotState ? decode(letter.bytes, &state) : decode(letter.bytes, &obstacles);
      ASSERT_EQ(refusal, Refusal::kNone) << text;
    }
    capture.out.letters.clear();
    capture.run_for(0.001);
  }
  EXPECT_GT(capture.refused(MocapRefusal::kJson), 1000);
  EXPECT_GT(capture.node.report().datagrams, 100);
}

TEST(Mocap, ReadsRulesAndSaysWhatIsWrongWithThem) {
  EXPECT_TRUE(parse_obstacle_rules("").empty());
  const auto rules = parse_obstacle_rules("a:sphere:0.5;b*:ring:1,0.1:1,2,3");
  ASSERT_EQ(rules.size(), 2u);
  EXPECT_TRUE(rules[0].matches("a"));
  EXPECT_FALSE(rules[0].matches("ab"));
  EXPECT_TRUE(rules[1].matches("bob"));
  EXPECT_FALSE(rules[1].matches("ab"));
  EXPECT_EQ(rules[1].offset, Eigen::Vector3d(1, 2, 3));
  for (const char* text : {"a", "a:column", "a:column:1", "a:column:1,2,3", "a:cone:1,2", ":sphere:1", "a:sphere:-1",
                           "a:sphere:1:0,0", "a:sphere:nan", "a:sphere:1;", "a:sphere:1:1,2,3:4", "a:box:1,2,x"})
    EXPECT_THROW((void)parse_obstacle_rules(text), OptionError) << text;
}

TEST(MocapLog, TellsChanges) {
  Capture capture;
  MocapLog log;
  const auto lines = [&] {
    std::string all;
    for (const LogLine& line : log.update(capture.now, capture.node.report()))
      all += (line.warning ? "! " : "- ") + line.text + "\n";
    return all;
  };
  EXPECT_EQ(lines(), "");
  capture.watch(0.3, [](double) { return json::array({make_body("person1", {1, 1, 1})}); });
  EXPECT_EQ(lines(), "- motion capture is heard\n- 1 obstacles\n");
  capture.hear("x");
  EXPECT_EQ(lines(), "! 1 datagrams refused; the newest: the datagram is not one JSON object\n");
  capture.hear("y");
  EXPECT_EQ(lines(), "");
  capture.run_for(1.0);
  EXPECT_EQ(lines(),
            "! motion capture is silent\n! 1 datagrams refused; the newest: the datagram is not one JSON object\n");
  capture.run_for(9.0);
  EXPECT_NE(lines().find("30 datagrams, 0 states"), std::string::npos);
}

TEST(Mocap, ObstaclesAreNoYoungerThanNowWhenTheClockIsSetBack) {
  Capture capture;
  capture.watch(0.3, [](double) {
    return json::array({make_body("person1", {1, 1, 1}), make_body("door", {2, 2, 1})});
  });
  capture.now -= 5s;
  capture.step();
  const int before = capture.out.count(channel::kObstacles);
  const auto only_the_door = [](double) { return json::array({make_body("door", {2, 2, 1})}); };
  capture.watch(0.3, only_the_door);
  EXPECT_EQ(capture.obstacles().num_obstacles, 2);
  EXPECT_GE(capture.out.count(channel::kObstacles) - before, 7);  // each can be decoded
  EXPECT_EQ(capture.out.all<obstacles_t>(channel::kObstacles).back().obstacles.size(), 2u);
  capture.watch(0.3, only_the_door);
  EXPECT_EQ(capture.obstacles().num_obstacles, 1);
}

}  // namespace
}  // namespace swarm::test
