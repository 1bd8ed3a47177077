// An operator sends the real daemons of one robot from place to place.
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

TEST(Goal, LeadsARobotFromPlaceToPlace) {
  const std::string onboard = local_url(base_port() + 1), swarm = local_url(base_port());
  const auto daemon = [&](const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> words = {name, "--robot-id", "3", "--onboard-url", onboard};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  const auto goal = [&](const std::vector<std::string>& words) {
    std::vector<std::string> all = {"swarm_goal", "--onboard-url", onboard};
    all.insert(all.end(), words.begin(), words.end());
    return run_program(all, 120.0);
  };
  const Finished silent = goal({"--patience", "0.3", "3", "1", "0", "1"});
  EXPECT_EQ(silent.exit_code, 1);
  EXPECT_EQ(silent.out, "robot 3: nothing was heard of it on " + onboard + "\n");
  std::vector<std::string> planning = {"--space-min=-9,-9,0.3", "--space-max=9,9,3"};
  if (kSanitized) planning.insert(planning.end(), {"--lead", "0.4", "--period", "0.3", "--stale-map", "2"});
  Program map(daemon("map_daemon", {})), planner(daemon("planner_daemon", planning)),
      broadcast(daemon("broadcast_daemon", {"--roster", "3", "--insecure", "true", "--swarm-url", swarm})),
      state({"../examples/send_state", onboard, "3"});
  const std::string patience = kSanitized ? "60" : "10";
  const Finished there = goal({"--patience", patience, "--arrive", "true", "3", "1,0,1", "-0.5,.5,1"});
  EXPECT_EQ(there.exit_code, 0) << there.err;
  EXPECT_EQ(there.out,
            "robot 3: flies to [1,0,1] (1 of 2)\nrobot 3: flies to [-0.5,0.5,1] (2 of 2)\n"
            "robot 3: is at [-0.5,0.5,1] (2 of 2)\n");
  const Finished above = goal({"--patience", "2", "3", "1,0,8"});
  EXPECT_EQ(above.exit_code, 1);
  EXPECT_EQ(above.out, "robot 3: no way leads to [1,0,8]\n") << planner.err();
  const Finished stays = goal({"--patience", patience, "3", "hold"});
  EXPECT_EQ(stays.exit_code, 0) << stays.out << stays.err;
}

TEST(Goal, WhatMakesNoSenseIsRefused) {
  const auto refusal = [](std::vector<std::string> words) {
    words.insert(words.begin(), "swarm_goal");
    const Finished result = run_program(words);
    EXPECT_EQ(result.exit_code, 2);
    return result.err;
  };
  EXPECT_EQ(refusal({"3", "1,2"}), "swarm_goal: place '1,2': must be X,Y,Z, each within [-100000, 100000] m\n");
  EXPECT_EQ(refusal({"--speed", "0.01", "3", "hold"}), "swarm_goal: --speed 0.01: must be 0 or at least 0.05 m/s\n");
  EXPECT_EQ(refusal({"--onboard-url", "udpm://239.255.76.67:7700?ttl=0", "3", "hold", "4", "hold"}),
            "swarm_goal: --onboard-url udpm://239.255.76.67:7700?ttl=0: only for one robot, not 2\n");
}

}  // namespace
}  // namespace swarm::test
