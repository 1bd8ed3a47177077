// tools/swarm: one file for the swarm.
#include <filesystem>
#include <nlohmann/json.hpp>

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;

class SwarmFile : public testing::Test {
 protected:
  SwarmFile() {
    file_ = {{"name", "three"},
             {"space", {{"min", {-5, -5, 0.2}}, {"max", {5, 5, 3}}}},
             {"limits", {{"speed", 2}, {"acceleration", 6}}},
             {"obstacles", nlohmann::json::array()}};
    for (int id = 0; id < 3; ++id)
      file_["robots"].push_back({{"id", id}, {"start", {2.0 * id - 3.0, -3, 0.3}}, {"radius", 0.25}});
  }
  Finished swarm(std::vector<std::string> words, const std::string& environment = "", double seconds = 90.0) {
    write_text(directory_ / "swarm.json", file_.dump(1));
    std::vector<std::string> all = {"/usr/bin/env", "-C", directory_.path()};
    if (!environment.empty()) all.push_back(environment);
    all.insert(all.end(), {SWARM_SOURCE_DIR "/tools/swarm"});
    all.insert(all.end(), words.begin(), words.end());
    all.insert(all.end(),
               {"--programs", SWARM_BIN_DIR, "--out", directory_ / "out", "--base-port", std::to_string(base_port())});
    return run_program(all, seconds);
  }
  std::string refusal(std::vector<std::string> words = {"check"}) {
    const Finished told = swarm(std::move(words));
    EXPECT_EQ(told.exit_code, 2) << told.out;
    return told.err;
  }

  TemporaryDirectory directory_;
  nlohmann::json file_;
};

TEST_F(SwarmFile, WhatIsWrongWithItIsNamed) {
  const nlohmann::json good = file_;
  const auto with = [&](const std::function<void(nlohmann::json&)>& spoil) {
    file_ = good;
    spoil(file_);
    return refusal();
  };
  EXPECT_EQ(swarm({"check"}).out, "swarm: swarm.json is good: 3 robots\n");
  EXPECT_EQ(with([](auto& f) { f.erase("robots"); }),
            "swarm: swarm.json: robots: must be a list of at least one robot\n");
  EXPECT_EQ(with([](auto& f) { f["robots"][1]["id"] = "x"; }),
            "swarm: swarm.json: robots[1].id: must be a whole number\n");
  EXPECT_EQ(with([](auto& f) { f["robots"][1]["host"] = "pilot@one"; }),
            "swarm: swarm.json: robots: all have a host, or none has\n");
  EXPECT_EQ(with([](auto& f) { f["robots"][0]["host"] = "-oProxyCommand=x"; }),
            "swarm: swarm.json: robots[0].host: '-oProxyCommand=x' must be NAME or USER@NAME\n");
  EXPECT_NE(with([](auto& f) {
              f["robots"][2]["goal"] = {0, 0, 1};
            }).find("robots[2].goal: robots of a swarm file have none"),
            std::string::npos);
  const std::string twice = with([](auto& f) { f["robots"][1]["id"] = 0; });
  EXPECT_NE(twice.find("swarm.json"), twice.npos) << twice;
  EXPECT_NE(twice.find("id"), twice.npos) << twice;
  EXPECT_EQ(with([](auto& f) { f["explores"] = "false"; }),
            "swarm: swarm.json: explores: 'false' must be true or false\n");
  EXPECT_EQ(with([](auto& f) { f["insecure"] = 1; }), "swarm: swarm.json: insecure: 1 must be true or false\n");
  EXPECT_NE(with([](auto& f) { f["clock_error"] = 5; }).find("clock-error"), std::string::npos);
  file_ = good;
  EXPECT_NE(refusal({"tell", "7", "land"}).find("robot '7': must be one of 0,1,2, or all"), std::string::npos);
  EXPECT_NE(refusal({"check", "elsewhere.json"}).find("elsewhere.json: no such file"), std::string::npos);
}

TEST_F(SwarmFile, MakesEveryRobotsConfiguration) {
  file_["robots"][1]["limits"] = {{"speed", 1}, {"acceleration", 3}};
  file_["clock_error"] = 0.02;
  file_["explores"] = false;
  const Finished made = swarm({"env"});
  EXPECT_EQ(made.exit_code, 0) << made.err;
  const std::string env = read_text(directory_ / "out/robot-1.env");
  for (const char* line :
       {"ROBOT_ID=1\n", "ROSTER=0,1,2\n", "RADIUS=0.25\n", "V_MAX=1\n", "A_MAX=3\n", "SPACE_MIN=-5,-5,0.2\n",
        "SPACE_MAX=5,5,3\n", "STATIC_MAP=\n", "EXPLORES=false\n", "CLOCK_ERROR=0.02\n", "INSECURE=false\n"})
    EXPECT_NE(env.find(line), env.npos) << line << env;
  EXPECT_NE(read_text(directory_ / "out/robot-2.env").find("V_MAX=2\n"), std::string::npos);
  file_.erase("explores");
  ASSERT_EQ(swarm({"env"}).exit_code, 0);
  EXPECT_NE(read_text(directory_ / "out/robot-1.env").find("EXPLORES=true\n"), std::string::npos);
}

// From nothing to nothing, on this computer.
TEST_F(SwarmFile, StartsTellsAndEndsRobotsOnOneComputer) {
  if (kSanitized) GTEST_SKIP() << "daemons of three robots are too slow";
  const Finished early = swarm({"status"});
  EXPECT_EQ(early.exit_code, 1);
  EXPECT_EQ(early.err, "swarm: is not up; tools/swarm up starts it\n");
  const Finished up = swarm({"up"});
  ASSERT_EQ(up.exit_code, 0) << up.err << up.out;
  EXPECT_EQ(swarm({"up"}).exit_code, 1) << "twice";
  const Finished ground = swarm({"status"});
  EXPECT_EQ(ground.exit_code, 0) << ground.out;
  EXPECT_EQ(ground.out.find("robot 0  on the ground  at [-3.00,-3.00,0.30]\n"), 0u) << ground.out;
  const Finished risen = swarm({"tell", "all", "take-off", "--arrive"});
  EXPECT_EQ(risen.exit_code, 0) << risen.out << risen.err;
  const Finished flown = swarm({"tell", "1", "0,0,1", "1,0,1", "--arrive"});
  EXPECT_EQ(flown.exit_code, 0) << flown.out << flown.err;
  EXPECT_NE(swarm({"status"}).out.find("robot 1  flying to [1,0,1] (2 of 2)"), std::string::npos);
  const Finished down = swarm({"down"});
  EXPECT_EQ(down.exit_code, 0) << down.out << down.err;
  EXPECT_NE(down.out.find("robot 2: is on the ground\n"), down.out.npos) << down.out;
  EXPECT_EQ(swarm({"down"}).exit_code, 1);
  const auto report = nlohmann::json::parse(read_text(directory_ / "out/report.json"));
  EXPECT_EQ(report["outcome"], "success");
}

// Robots with computers of their own: what is done there, by an ssh that only notes it.
TEST_F(SwarmFile, StartsAndEndsServicesOnHosts) {
  write_text(
      directory_ / "ssh",
      "#!/bin/bash\ninput=''\n[[ $2 != *tee* && $2 != *install* ]] || input=$(cat)\n"
      "echo \"$1: $2 <${input:0:16}>\" >> '" +
          (directory_ / "said").string() +
          "'\n"
          "[[ $1 != gone ]] || { echo 'no route' >&2; exit 255; }\n[[ $2 != *status* ]] || echo \"robot of $1\"\n");
  fs::permissions(directory_ / "ssh", fs::perms::owner_all);
  const std::string ssh = "SWARM_SSH=" + (directory_ / "ssh").string();
  const auto said = [&] {
    const std::string text = fs::exists(directory_ / "said") ? read_text(directory_ / "said") : "";
    fs::remove(directory_ / "said");
    return text;
  };
  for (int id = 0; id < 3; ++id) file_["robots"][static_cast<std::size_t>(id)]["host"] = "robot" + std::to_string(id);
  Finished up = swarm({"up"}, ssh);
  EXPECT_EQ(up.exit_code, 2);
  EXPECT_NE(up.err.find("key: must name the file of the swarm's key"), up.err.npos) << up.err;
  file_["key"] = "swarm.key";
  EXPECT_NE(swarm({"up"}, ssh).err.find("swarm.key: no such file"), std::string::npos);
  EXPECT_EQ(said(), "") << "nobody is started with half of it";
  write_text(directory_ / "swarm.key", std::string(64, 'a') + "\n");
  up = swarm({"up"}, ssh);
  EXPECT_EQ(up.exit_code, 0) << up.err;
  std::string done = said();
  EXPECT_EQ(done.find("robot0: sudo tee /etc/sogm_swarm/robot.env > /dev/null <"), 0u) << done;
  EXPECT_NE(done.find("robot2: sudo install -m 600 /dev/stdin /etc/sogm_swarm/swarm.key <aaaaaaaaaaaaaaaa>\n"
                      "robot2: sudo systemctl restart swarm.target <>\n"),
            done.npos)
      << done;
  EXPECT_EQ(swarm({"status"}, ssh).out, "robot of robot0\nrobot of robot1\nrobot of robot2\n");
  (void)said();
  EXPECT_EQ(swarm({"tell", "1,2", "0,0,1"}, ssh).exit_code, 0);
  done = said();
  EXPECT_NE(
      done.find(
          "robot1: swarm_goal --onboard-url 'udpm://239.255.76.67:7700?ttl=0' --arrive false --patience 20 1 0,0,1"),
      done.npos)
      << done;
  EXPECT_EQ(done.find("robot0"), done.npos);
  EXPECT_EQ(swarm({"down"}, ssh).exit_code, 0);
  done = said();
  EXPECT_LT(done.find("1 land"), done.find("robot0: sudo systemctl stop swarm.target")) << done;
  file_["robots"][1]["host"] = "gone";
  const Finished status = swarm({"status"}, ssh);
  EXPECT_EQ(status.exit_code, 1);
  EXPECT_NE(status.out.find("robot 1  ! gone: no route\n"), std::string::npos) << status.out;
}

}  // namespace
}  // namespace swarm::test
