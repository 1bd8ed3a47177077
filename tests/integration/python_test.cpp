// The Python package: it tells the real daemons of one robot where to go and what to do, and reads logs.
#include <lcm/lcm-cpp.hpp>

#include "lcmtypes/bus/channels.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

class Python : public testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists("/usr/bin/python3")) GTEST_SKIP() << "there is no Python";
  }
  // Runs lines of Python.
  static Finished python(const std::string& lines, double seconds = 20.0) {
    return run_program({"/usr/bin/env", "PYTHONPATH=" SWARM_BIN_DIR "/../python", "PYTHONDONTWRITEBYTECODE=1",
                        "/usr/bin/python3", "-c", lines},
                       seconds);
  }
};

TEST_F(Python, FliesARobot) {
  const std::string onboard = local_url(base_port() + 1), swarm = local_url(base_port());
  const auto daemon = [&](const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> words = {name, "--robot-id", "3", "--onboard-url", onboard};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  std::vector<std::string> planning = {"--space-min=-9,-9,0.3", "--space-max=9,9,3"};
  if (kSanitized) planning.insert(planning.end(), {"--lead", "0.4", "--period", "0.3", "--stale-map", "2"});
  const std::string robot =
      "import math\nfrom sogm_swarm.bus import Bus\nfrom sogm_swarm.robot import NotDone, Robot\n"
      "robot = Robot(Bus('" +
      onboard +
      "', 3))\n"
      "def tried(action, *arguments, **options):\n"
      "    try:\n"
      "        action(*arguments, **options)\n"
      "    except (NotDone, ValueError) as error:\n"
      "        print(error)\n";
  const Finished silent = python(robot + "tried(robot.go, (1, 0, 1), patience=0.3)");
  EXPECT_EQ(silent.out, "robot 3: was not heard on " + onboard + "\n") << silent.err;

  Program map(daemon("map_daemon", {})), planner(daemon("planner_daemon", planning)),
      broadcast(daemon("broadcast_daemon", {"--roster", "3", "--insecure", "true", "--swarm-url", swarm})),
      state({"../examples/send_state", onboard, "3"});
  const Finished flown = python(robot + "patience = " + (kSanitized ? "60" : "10") + "\n" +
                                    "robot.go((1, 0, 1), (-0.5, 0.5, 1), arrive=True, patience=patience)\n"
                                    "print('there:', math.dist(robot.state.position, (-0.5, 0.5, 1)) <= 0.1)\n"
                                    "robot.order('hold', arrive=True, patience=patience)\n"
                                    "robot.go((0.5, 0.5, 1), arrive=True, patience=patience)  # and no longer holds\n"
                                    "print('there:', math.dist(robot.state.position, (0.5, 0.5, 1)) <= 0.1)\n"
                                    "tried(robot.go, (1, 0, 8), patience=2)\n"
                                    "tried(robot.order, 'take-off', patience=patience)\n"
                                    "tried(robot.order, 'loop')\n",
                                120.0);
  EXPECT_EQ(flown.exit_code, 0) << flown.err << planner.err();
  EXPECT_EQ(flown.out,
            "there: True\nthere: True\nrobot 3: knows no way there\nrobot 3: has no use for that now\n"
            "order 'loop': must be one of fly, hold, take-off, home, land, emergency, without\n");
}

// Some messages of two channels, with garbage between.
void write_log(const std::string& path) {
  const auto write = [](const std::string& file, const char* mode, const char* channel, Bytes bytes, int i) {
    lcm::LogFile log(file, mode);
    lcm::LogEvent event{};
    event.timestamp = to_us(kStart) + i;
    event.channel = channel;
    event.datalen = static_cast<std::int32_t>(bytes.size());
    event.data = bytes.data();
    EXPECT_EQ(log.writeEvent(&event), 0);
  };
  for (int i = 0; i < 4; ++i) {
    Bytes state = encoded(state_at(3, {0.5 * i, -1.0, 2.0}, i, kStart + i * 20ms));
    if (i == 2) state.back() ^= 1;  // damaged
    write(path, i == 0 ? "w" : "a", channel::kRobotState, state, i);
    sogm_swarm::goal_t goal{};
    goal.header = make_header(3, 1, i, kStart);
    goal.waypoints.resize(static_cast<std::size_t>(i + 1));
    goal.num_waypoints = i + 1;
    goal.waypoints.back().position[0] = i;
    write(path, "a", channel::kGoal, encoded(goal), 10 * i);
    std::ofstream(path, std::ios::binary | std::ios::app) << "\xED\xA1\xDA\x01 no event";
  }
}

TEST_F(Python, ReadsLogsAsArrays) {
  if (python("import numpy").exit_code != 0) GTEST_SKIP() << "there is no numpy";
  const TemporaryDirectory directory;
  write_log(directory / "log.lcm");
  const std::string log =
      "from sogm_swarm.logs import arrays, events\nlog = '" + (directory / "log.lcm").string() + "'\n";
  const Finished read = python(log +
                               "states = arrays(log, 'ROBOT_STATE')\n"
                               "print(states['position'].tolist(), states['header.seq'].tolist())\n"
                               "print((states['logged'] - states['logged'][0]).tolist(), states['yaw'].shape)\n"
                               "goals = arrays(log, 'GOAL')\n"
                               "print([[w.position[0] for w in way] for way in goals['waypoints']])\n"
                               "print(list(arrays(log, 'SETPOINT')), len(list(events(log))))\n");
  EXPECT_EQ(read.exit_code, 0) << read.err;
  EXPECT_EQ(read.out,
            "[[0.0, -1.0, 2.0], [0.5, -1.0, 2.0], [1.5, -1.0, 2.0]] [0, 1, 3]\n"
            "[0, 1, 3] (3,)\n"
            "[[0.0], [0.0, 1.0], [0.0, 0.0, 2.0], [0.0, 0.0, 0.0, 3.0]]\n"
            "['logged'] 8\n");
}

TEST_F(Python, SaysThatArraysNeedNumpy) {
  const Finished without = python(
      "import sys\nsys.modules['numpy'] = None\nfrom sogm_swarm.logs import arrays\narrays('log.lcm', 'ROBOT_STATE')");
  EXPECT_EQ(without.exit_code, 1);
  EXPECT_NE(without.err.find("arrays() needs numpy: apt install python3-numpy"), std::string::npos) << without.err;
}

TEST_F(Python, IsMissedByTheExamplesInSoManyWords) {
  const TemporaryDirectory directory;
  for (const char* name : {"arguments.py", "send_goal.py"})
    std::filesystem::copy(SWARM_SOURCE_DIR "/tools/deploy/examples/" + std::string(name), directory.path());
  const std::string example = directory / "send_goal.py";
  const Finished without =
      run_program({"/usr/bin/env", "PYTHONDONTWRITEBYTECODE=1", "/usr/bin/python3", "-S", example});
  EXPECT_EQ(without.exit_code, 1);
  EXPECT_EQ(without.err,
            "The Python package sogm_swarm is missing: install the Debian package, or in a checkout run tools/build\n");
}

TEST_F(Python, RefusesWhatIsNoGoodMessage) {
  const Finished told = python(
      "from sogm_swarm import codec, goal_t, header_t, robot_state_t\n"
      "state = robot_state_t()\n"
      "state.header.schema_version = header_t.kSchemaVersion\n"
      "good = codec.encode(state)\n"
      "print(codec.type_of(good).__name__, codec.type_of(b'12345678'))\n"
      "codec.decode(good, robot_state_t)\n"
      "codec.decode(good + b'SEAL' + bytes(16), robot_state_t)\n"
      "state.header.schema_version += 1\n"
      "for data, kind in [(good[:20], robot_state_t), (good, goal_t), (good[:-1] + b'x', robot_state_t),\n"
      "                   (codec.encode(state), robot_state_t)]:\n"
      "    try:\n"
      "        codec.decode(data, kind)\n"
      "    except codec.Refused as error:\n"
      "        print(error)\n");
  EXPECT_EQ(told.exit_code, 0) << told.err;
  EXPECT_EQ(told.out,
            "robot_state_t None\n20 bytes are too short for a message\nthis is no goal_t, or that of another version\n"
            "damaged: its CRC is wrong\nschema version 3, not 2\n");
}

}  // namespace
}  // namespace swarm::test
