#include "tools/viewer/goal_json.h"

#include <gtest/gtest.h>

#include <limits>

#include "lcmtypes/bus/limits.h"

namespace swarm::test {
namespace {

std::string refusal(const std::string& text) {
  try {
    (void)read_goal(Json::parse(text));
    return "";
  } catch (const std::exception& error) {
    return error.what();
  }
}

// One waypoint with a good position and these further entries.
std::string with_waypoint(const std::string& more) {
  return R"({"robot": 0, "waypoints": [{"position": [0, 0, 1]}, {"position": [1, 2, 3])" + more + "}]}";
}

TEST(GoalJson, PlacesOneAfterTheOtherSoOften) {
  const GoalOrder order = read_goal(Json::parse(
      R"({"robot": 3, "waypoints": [{"position": [1, -2.5, 1]}, {"position": [0, 0, 2], "wait_s": 1.5}], "times": 2})"));
  EXPECT_EQ(order.robot_id, 3);
  const Waypoint first{.position = {1.0, -2.5, 1.0}}, second{.position = {0.0, 0.0, 2.0}, .wait = 1500ms};
  EXPECT_EQ(order.mission, (Mission{first, second, first, second}));
  EXPECT_FALSE(order.order);
}

TEST(GoalJson, TakesAsMuchAsAGoalHolds) {
  Json goal = {{"robot", 0}, {"waypoints", Json::array()}, {"times", 2}};
  for (int i = 0; i < kMaxWaypoints / 2; ++i) goal["waypoints"].push_back({{"position", {i, 0, 1}}});
  EXPECT_EQ(std::ssize(read_goal(goal).mission), kMaxWaypoints);
  goal["waypoints"].push_back({{"position", {0, 0, 1}}});
  EXPECT_EQ(refusal(goal.dump()), "goal: waypoints times times 1002: must be at most 1000");
}

TEST(GoalJson, SaysWhichValueBreaksWhichRule) {
  EXPECT_EQ(refusal("3"), "goal 3: must be an object");
  EXPECT_EQ(refusal(R"({"waypoints": []})"), "goal: must have 'robot'");
  EXPECT_EQ(refusal(R"({"robot": 0})"), "goal: must have 'waypoints'");
  EXPECT_EQ(refusal(R"({"robot": 0, "waypoints": []})"), "goal: waypoints []: must be a list of at least one");
  EXPECT_EQ(refusal(R"({"robot": 0, "waypoints": {"a": 1}})"),
            R"(goal: waypoints {"a":1}: must be a list of at least one)");
  EXPECT_EQ(refusal(R"({"robot": 0, "waypoints": [], "speed": 2})"), R"(goal: key "speed": must be one that is known)");
  for (const char* robot : {"-1", "32768", "1e30"})
    EXPECT_NE(refusal(R"({"waypoints": [], "robot": )" + std::string(robot) + "}").find("within [0, 32767]"),
              std::string::npos)
        << robot;
  EXPECT_EQ(refusal(R"({"waypoints": [], "robot": 0.5})"), "goal: robot 0.5: must be an integer within [0, 32767]");
  EXPECT_EQ(refusal(R"({"waypoints": [], "robot": true})"), "goal: robot true: must be an integer within [0, 32767]");
  for (const char* times : {"0", "1001", "-3", "18446744073709551615", "2.5", "\"2\""})
    EXPECT_NE(refusal(R"({"robot": 0, "waypoints": [{"position": [0, 0, 1]}], "times": )" + std::string(times) + "}")
                  .find("within [1, 1000]"),
              std::string::npos)
        << times;
  EXPECT_EQ(refusal(with_waypoint("")), "");
  EXPECT_EQ(refusal(with_waypoint(R"(, "wait_s": 86400)")), "");
  EXPECT_EQ(refusal(with_waypoint(R"(, "wait_s": -1)")), "waypoint 2: wait_s -1: must be a number within [0, 86400]");
  EXPECT_EQ(refusal(with_waypoint(R"(, "wait_s": 86401)")),
            "waypoint 2: wait_s 86401: must be a number within [0, 86400]");
  EXPECT_EQ(refusal(with_waypoint(R"(, "wait_s": null)")),
            "waypoint 2: wait_s null: must be a number within [0, 86400]");
  EXPECT_EQ(refusal(with_waypoint(R"(, "speed": 1)")), R"(waypoint 2: key "speed": must be one that is known)");
  const auto position = [](const std::string& text) {
    return refusal(R"({"robot": 0, "waypoints": [{"position": )" + text + "}]}");
  };
  EXPECT_EQ(position("[1, 2]"), "waypoint 1: position [1,2]: must be [x, y, z]");
  EXPECT_EQ(position("[1, 2, 100001]"), "waypoint 1: coordinate 100001: must be a number within [-1e+05, 1e+05]");
  EXPECT_EQ(position("[1, null, 3]"), "waypoint 1: coordinate null: must be a number within [-1e+05, 1e+05]");
  EXPECT_EQ(position('"' + std::string(100, 'x') + '"'),
            "waypoint 1: position \"" + std::string(39, 'x') + "...: must be [x, y, z]")
      << "a long value is cut";
  Json nan = Json::parse(with_waypoint(""));
  nan["waypoints"][0]["position"][0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)read_goal(nan), std::runtime_error);
}

}  // namespace
}  // namespace swarm::test
