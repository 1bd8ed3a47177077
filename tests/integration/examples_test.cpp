// The tutorial's examples against the real daemons of one robot: its state, an obstacle and a goal go in, setpoints
// come out that lead around the obstacle to the goal; and a depth camera shows a wall. In C++ and in Python.
#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;

class Examples : public testing::TestWithParam<const char*> {
 protected:
  bool is_python() const { return std::string(GetParam()) == "Python"; }
  void SetUp() override {
    if (!is_python()) return;
    if (!fs::exists("/usr/bin/python3")) GTEST_SKIP() << "there is no Python";
  }
  std::vector<std::string> example(const std::string& name, std::vector<std::string> arguments) {
    std::vector<std::string> words;
    if (is_python()) {
      words = {"/usr/bin/env", "PYTHONPATH=" SWARM_BIN_DIR "/../python", "PYTHONDONTWRITEBYTECODE=1",
               "/usr/bin/python3", SWARM_SOURCE_DIR "/tools/deploy/examples/" + name + ".py"};
    } else {
      words = {"../examples/" + name};
    }
    words.insert(words.end(), arguments.begin(), arguments.end());
    return words;
  }
};

std::vector<Eigen::Vector3d> positions(const std::string& text) {
  std::vector<Eigen::Vector3d> all;
  std::istringstream in(text.substr(0, text.rfind('\n') + 1));
  for (Eigen::Vector3d p; in >> p.x() >> p.y() >> p.z();) all.push_back(p);
  return all;
}

TEST_P(Examples, FlyARobot) {
  const std::string onboard = local_url(base_port() + 1), swarm = local_url(base_port());
  const std::vector<std::string> common = {"--robot-id", "3", "--onboard-url", onboard};
  const auto daemon = [&](const std::string& name, std::vector<std::string> more) {
    std::vector<std::string> words = {name};
    words.insert(words.end(), common.begin(), common.end());
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  std::vector<std::string> planning = {"--space-min=-9,-9,0.3", "--space-max=9,9,3"};
  if (kSanitized) planning.insert(planning.end(), {"--lead", "0.4", "--period", "0.3", "--stale-map", "2"});
  Program map(daemon("map_daemon", {})), planner(daemon("planner_daemon", planning)),
      broadcast(daemon("broadcast_daemon", {"--roster", "3", "--insecure", "true", "--swarm-url", swarm}));
  Program state(example("send_state", {onboard, "3"})), obstacles(example("send_obstacles", {onboard, "3"})),
      setpoints(example("take_setpoints", {onboard, "3"}));
  EXPECT_TRUE(wait_for(10.0 * kPatience, [&] { return positions(setpoints.out()).size() > 20; }))
      << state.err() << setpoints.err() << broadcast.err();
  for (const Eigen::Vector3d& at : positions(setpoints.out())) EXPECT_LT((at - Eigen::Vector3d(0, 0, 1)).norm(), 1e-6);
  Program goal(example("send_goal", {onboard, "3"}));
  EXPECT_TRUE(wait_for(20.0 * kPatience,
                       [&] {
                         const auto all = positions(setpoints.out());
                         return !all.empty() && (all.back() - Eigen::Vector3d(3, 0, 1)).norm() < 0.05;
                       }))
      << goal.err() << planner.err();
  for (const Eigen::Vector3d& at : positions(setpoints.out()))
    EXPECT_GT((at - Eigen::Vector3d(1.5, 0.1, at.z())).norm(), 0.5) << "a person stands there";
}

TEST_P(Examples, ShowAWallToPerception) {
  const std::string onboard = local_url(base_port() + 1);
  LcmBus bus(onboard);
  sogm_swarm::perception_status_t status{};
  int standing = 0;
  bus.subscribe(channel::kPerceptionStatus, [&](auto, auto bytes) { (void)decode(bytes, &status); });
  bus.subscribe(channel::kSeenSpace, [&](auto, auto) { ++standing; });
  Program perception({"perception_daemon", "--robot-id", "3", "--onboard-url", onboard});
  Program depth(example("send_depth", {onboard, "3"}));
  EXPECT_TRUE(wait_for(20.0 * kPatience,
                       [&] {
                         bus.drain();
                         return status.scans > 20 && standing > 20;
                       }))
      << depth.err() << perception.err();
  EXPECT_GT(status.points, 100) << "the wall";
  EXPECT_EQ(status.blind, 0);
  EXPECT_EQ(std::count(std::begin(status.refused), std::end(status.refused), 0), std::ssize(status.refused));
}

TEST_P(Examples, AnswerWrongWordsWithTheUsage) {
  const std::string onboard = local_url(base_port() + 1);
  const auto refuses = [&](const std::string& name, const std::vector<std::string>& words) {
    const Finished refused = run_program(example(name, words));
    EXPECT_EQ(refused.exit_code, 2) << name << ": " << refused.err;
    EXPECT_NE(refused.err.find("usage: "), std::string::npos) << refused.err;
  };
  for (const char* name : {"send_state", "send_obstacles", "send_depth", "send_goal", "take_setpoints"})
    refuses(name, {"1", "2", "3"});
  refuses("send_goal", {"3"});
  refuses("send_goal", {"udpm://10.0.0.1:7700?ttl=0"});
  refuses("send_goal", {onboard, "three"});
  refuses("send_goal", {onboard, "40000"});
  refuses("send_goal", {onboard, "3", "4"});
}

INSTANTIATE_TEST_SUITE_P(, Examples, testing::Values("Cpp", "Python"), [](const auto& name) { return name.param; });

}  // namespace
}  // namespace swarm::test
