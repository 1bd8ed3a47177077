// The programs as an operator meets them: what is wrong is told in one line, --help and --print-config tell the truth,
// SIGTERM ends them, and garbage on the bus is only counted. Long because every program is tried in the same ways.
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

constexpr const char* kGoodWorld = R"({"name": "two",
 "space": {"min": [-8,-8,0], "max": [8,8,4]},
 "limits": {"speed": 2.0, "acceleration": 6.0},
 "robots": [{"id": 0, "start": [-3,0,1], "goal": [3,0,1], "radius": 0.2},
  {"id": 1, "start": [3,0,1], "goal": [-3,0,1], "radius": 0.2}],
 "obstacles": [{"shape": "column", "center": [0,5], "diameter": 0.8, "height": 4.0}]})";

// Rest to rest along x without corridors' faces; `x` m in 2 s.
std::string qp_line(const std::string& name, double x) {
  std::ostringstream line;
  line << R"({"name": ")" << name << R"(", "degree": 5, "durations_s": [1, 1], "v_max": 2, "a_max": 6,)"
       << R"( "start": {"p": [0,0,0], "v": [0,0,0], "a": [0,0,0]}, "end": {"p": [)" << x
       << R"(,0,0], "v": [0,0,0], "a": [0,0,0]}, "corridors": [{"A": [], "b": []}, {"A": [[0,1,0]], "b": [1]}]})";
  return line.str();
}

// Exit code 2 and one line on standard error that holds all of `texts`.
void expect_complaint(const Words& words, const std::vector<std::string>& texts) {
  std::string command;
  for (const std::string& word : words) command += word + " ";
  SCOPED_TRACE(command);
  const Finished finished = run_program(words);
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_EQ(finished.out, "");
  EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
  EXPECT_TRUE(finished.err.ends_with('\n')) << finished.err;
  for (const std::string& text : texts) {
    EXPECT_NE(finished.err.find(text), std::string::npos) << "'" << text << "' is missing in: " << finished.err;
  }
}

TEST(RunCommand, BadWorldsAreRefusedByFileKeyAndRule) {
  TemporaryDirectory directory;
  write_text(directory / "text.bt", "this is no OctoMap\n");
  struct Case {
    std::string from, to;
    std::vector<std::string> complaint;
  };
  const std::string start1 = "\"start\": [3,0,1]", radius = "\"radius\": 0.2", speed = "\"speed\": 2.0";
  const Case cases[] = {
      {kGoodWorld, "{\"name\": \"half\"", {"must be JSON"}},
      {kGoodWorld, "", {"must be JSON"}},
      {speed, "\"speed\": NaN", {"must be JSON"}},
      {speed, "\"speed\": 1e999", {"must be JSON"}},
      {speed, "\"speed\": 0", {"limits.speed: 0 must be a number in (0, 100]"}},
      {speed, "\"speed\": \"2\"", {"limits.speed: \"2\" must be a number"}},
      {"\"limits\"", "\"limit\"", {"\"limit\" is an unknown key", "limits"}},
      {"\"name\": \"two\",", "", {"name: is missing"}},
      {radius, "\"radius\": -0.2", {"robots[0].radius: -0.2 must be a number in (0, 10]"}},
      {radius, "\"radius\": 0.2, \"mass\": 1", {"robots[0]", "\"mass\" is an unknown key"}},
      {start1, "\"start\": [-3,0.3,1]", {"robots[1].start: [-3,0.3,1]", "sum of radii", "robots[0]"}},
      {start1, "\"start\": [0.2,5,1]", {"robots[1].start: [0.2,5,1]", "must not touch obstacles[0]"}},
      {start1, "\"start\": [9,0,1]", {"robots[1].start: [9,0,1]", "inside space"}},
      {"\"id\": 1", "\"id\": 0", {"robots[1].id: 0", "unique"}},
      {"\"id\": 1", "\"id\": 1.5", {"robots[1].id: 1.5 must be an integer"}},
      {"\"column\"", "\"cone\"", {"obstacles[0].shape: \"cone\" must be one of column, ring, box, sphere"}},
      {"\"robots\"", "\"static_map\": \"text.bt\", \"robots\"", {"text.bt"}},
      {"\"robots\"", "\"static_map\": \"none.bt\", \"robots\"", {"static_map: \"none.bt\" must be an existing file"}},
  };
  int number = 0;
  for (const Case& c : cases) {
    const fs::path file = directory / ("world" + std::to_string(++number) + ".json");
    write_text(file, replaced(kGoodWorld, c.from, c.to));
    std::vector<std::string> texts = c.complaint;
    if (c.complaint[0] != "text.bt") texts.push_back(file);
    expect_complaint({"swarm_sim", "run", file, "--out", directory / "out"}, texts);
  }
  expect_complaint({"swarm_sim", "run", directory / "none.json"}, {"none.json", "must be a readable world file"});
  expect_complaint({"swarm_sim", "run", directory.path()}, {directory.path(), "must be a readable world file"});
  EXPECT_FALSE(fs::exists(directory / "out"));
}

TEST(RunCommand, BadOptionsAreRefusedByNameValueAndRule) {
  TemporaryDirectory directory;
  const std::string world = write_text(directory / "world.json", kGoodWorld);
  const auto expect = [&](const Words& options, const std::vector<std::string>& texts) {
    Words words = {"swarm_sim", "run", world};
    words.insert(words.end(), options.begin(), options.end());
    expect_complaint(words, texts);
  };
  expect_complaint({"swarm_sim"}, {"no subcommand", "world, run, campaign, merge or audit"});
  expect_complaint({"swarm_sim", "fly"}, {"unknown subcommand 'fly'", "world, run, campaign, merge or audit"});
  expect_complaint({"swarm_sim", "run"}, {"world is missing"});
  expect({"extra"}, {"extra"});
  expect({"--fast"}, {"unknown option '--fast'"});
  expect({"--time-limit", "0"}, {"--time-limit 0", "[0.1, 86400] s"});
  expect({"--time-limit", "nan"}, {"--time-limit nan", "[0.1, 86400] s"});
  expect({"--time-limit"}, {"--time-limit"});
  expect({"--time-limit", "1", "--time-limit", "2"}, {"--time-limit", "twice"});
  expect({"--vehicle", "car"}, {"--vehicle car", "must be perfect, noisy or quadrotor"});
  expect({"--wind-mps", "-1"}, {"--wind-mps -1", "[0, 30] m/s"});
  expect({"--sensor-rate", "1000"}, {"--sensor-rate 1000", "[1, 100] Hz"});
  expect({"--link-loss", "1.5"}, {"--link-loss 1.5", "[0, 1]"});
  expect({"--link-rate-mbps", "60"}, {"--link-rate-mbps 60", "[0, 54]"});
  expect({"--link-rate-mbps", "7"}, {"link-rate-mbps 7", "6, 9, 12, 18, 24, 36, 48 or 54"});
  expect({"--mode", "processes", "--link-rate-mbps", "6"}, {"link-rate-mbps", "lock-step"});
  expect({"--link-outage", "1:3:2"}, {"--link-outage", "1:3:2", "ROBOT:FROM_S:TO_S"});
  expect({"--state-outage", "1:3:2"}, {"--state-outage", "1:3:2", "ROBOT:FROM_S:TO_S"});
  expect({"--mode", "processes", "--netns", "far", "--link-delay-ms", "5"}, {"netns", "--link-"});
  expect({"--mavlink", "position"}, {"mavlink", "lock-step", "--mode processes"});
  expect({"--mavlink", "true"}, {"--mavlink", "position or attitude"});
  expect({"--mode", "processes", "--mavlink", "attitude"}, {"mavlink", "--vehicle quadrotor", "perfect"});
  expect({"--mode", "processes", "--mavlink", "position", "--daemons", "false"},
         {"mavlink", "daemons that are started"});
  expect({"--kill", "map@1"}, {"--kill", "map@1", "DAEMON:ROBOT@AT_S"});
  expect({"--kill", "map:9@1"}, {"kill", "no robot 9"});
  expect({"--link-outage", "9:1:2"}, {"link-outage", "no robot 9"});
  expect({"--state-outage", "9:1:2"}, {"state-outage", "no robot 9"});
  expect({"--strangers", "1,far"}, {"--strangers", "'far'", "robot's id"});
  expect({"--strangers", "1,1"}, {"--strangers", "robot 1", "once"});
  expect({"--strangers", "9"}, {"strangers", "no robot 9"});
  expect({"--strangers", "1", "--cells", "8"}, {"strangers", "--cells"});
  expect({"--kill", "keeper@1"}, {"kill", "no keeper without --cells"});
  expect({"--cells", "8", "--mode", "processes", "--link-loss", "0.1"}, {"cells", "--link-..."});
  expect({"--kill", "map:9@1", "--mode", "processes"}, {"kill", "no robot 9"});
  expect({"--keep-maps", directory / "maps"}, {"keep-maps", "--sensor lidar or depth"});
  expect({"--base-port", "80"}, {"--base-port 80", "[1024, 60000]"});
  expect({"--mode", "warp"}, {"--mode warp", "lockstep or processes"});
  expect({"--config", directory / "none.cfg"}, {"none.cfg", "cannot be read"});
  expect({"--planner-config", directory / "none.cfg"}, {"none.cfg", "cannot be read"});
  const std::string config = write_text(directory / "bad.cfg", "lead = fast\n");
  expect({"--planner-config", config}, {config, "lead = fast", "[0.005, 0.5] s"});
  expect({"--map-config", config}, {config, "unknown key 'lead'"});
  write_text(directory / "bad.cfg", "emergency-clearance = 0.1\n");
  expect({"--planner-config", config}, {"--emergency-clearance"});
  for (const char* mode : {"lockstep", "processes"}) {  // a file is in the way
    expect({"--mode", mode, "--out", world + "/run"}, {world + "/run"});
  }
}

// At once, and not only in the report: an obstacle flies through both robots where they stand.
TEST(RunCommand, TouchesAreSaidWhenTheyHappen) {
  TemporaryDirectory directory;
  nlohmann::json json = nlohmann::json::parse(kGoodWorld);
  json["obstacles"] = {
      {{"shape", "column"}, {"center", {-4.0, 0}}, {"diameter", 0.8}, {"height", 4.0}, {"velocity", {20, 0}}}};
  const std::string world = write_text(directory / "world.json", json.dump());
  const Finished run = run_program({"swarm_sim", "run", world, "--time-limit", "1"}, 60.0);
  EXPECT_EQ(run.exit_code, 1) << run.err;
  const auto touch = run.err.find(" touched "), end = run.err.find("touches 0");
  EXPECT_NE(touch, std::string::npos) << run.err;
  EXPECT_NE(end, std::string::npos) << run.err << ": none had touched at the beginning";
  EXPECT_LT(end, touch) << run.err;
}

TEST(WorldCommand, BadOptionsWriteNothing) {
  TemporaryDirectory directory;
  const std::string file = directory / "world.json";
  const auto expect = [&](const Words& options, const std::vector<std::string>& texts) {
    Words words = {"swarm_sim", "world", "-o", file};
    words.insert(words.end(), options.begin(), options.end());
    expect_complaint(words, texts);
  };
  expect({"--task", "spiral"}, {"task", "spiral", "cross, bilateral, unilateral, circle"});
  expect({"--env", "wood"}, {"env", "wood", "empty, pure, mixed"});
  expect({"--obstacles", "501"}, {"--obstacles 501", "[-1, 500]"});
  expect({"--obstacles", "3", "--env", "empty"}, {"obstacles: 3", "[0, 0]"});
  expect({"--seed", "-1"}, {"--seed -1", "[0, 2147483647]"});
  expect({"--robots", "5"}, {"robots", "circle"});
  expect({"--task", "circle", "--robots", "1"}, {"robots: 1", "[2, 1000]"});
  expect({"--task", "circle", "--robots", "40", "--radius", "0.5"}, {"start", "sum of radii"});
  expect({"--sead", "1"}, {"unknown option '--sead'"});
  expect_complaint({"swarm_sim", "world"}, {"-o FILE"});
  EXPECT_TRUE(fs::is_empty(directory.path()));
  write_text(file, "mine");
  expect_complaint({"swarm_sim", "world", "-o", file + "/world.json"}, {file + "/world.json", "cannot be written"});
  expect({"--task", "spiral"}, {"spiral"});
  EXPECT_EQ(read_text(file), "mine");
}

TEST(WorldCommand, WritesWhatRunReads) {
  TemporaryDirectory directory;
  const std::string file = directory / "world.json";
  const Words generate = {"swarm_sim", "world", "--task", "circle",      "--robots", "2",      "--radius",
                          "3",         "--env", "pure",   "--obstacles", "4",        "--seed", "5"};
  Words to_file = generate, to_output = generate;
  to_file.insert(to_file.end(), {"-o", file});
  to_output.insert(to_output.end(), {"-o", "-"});
  EXPECT_EQ(run_program(to_file).exit_code, 0);
  EXPECT_EQ(run_program(to_output).out, read_text(file));
  const Finished run = run_program({"swarm_sim", "run", file, "--time-limit", "0.5"}, 60.0);
  EXPECT_EQ(run.exit_code, 1) << run.err;  // flown, but not to the end
  EXPECT_NE(run.out.find("timeout after 0.50 s"), std::string::npos) << run.out;
}

TEST(Daemons, BadOptionsAreRefusedByNameValueAndRule) {
  TemporaryDirectory directory;
  for (const char* daemon : {"map_daemon", "planner_daemon", "broadcast_daemon"}) {
    const auto expect = [&](Words options, std::vector<std::string> texts) {
      options.insert(options.begin(), daemon);
      texts.push_back(std::string(daemon) + ": ");
      expect_complaint(options, texts);
    };
    expect({"--onboard-url", "http://239.255.76.67:7700"}, {"--onboard-url", "http://", "udpm://ADDRESS:PORT"});
    expect({"--onboard-url", "udpm://10.0.0.1:7700"}, {"10.0.0.1", "224.0.0.0 to 239.255.255.255"});
    expect({"--onboard-url", "udpm://239.255.76.67:70000"}, {"70000", "port", "[1, 65535]"});
    expect({"--onboard-url", "udpm://239.255.76.67:7700?tll=0"}, {"unknown parameter 'tll'"});
    expect({"--robot-id", "-1"}, {"--robot-id -1", "[0, 32767]"});
    expect({"--robot-id", "1.5"}, {"--robot-id 1.5", "whole number"});
    expect({"--clock-limit", "inf"}, {"--clock-limit inf", "[0.001, 10] s"});
    expect({"--no-such-option", "1"}, {"unknown option '--no-such-option'"});
    expect({"stray"}, {"unexpected argument 'stray'"});
    expect({"--config", directory / "none.cfg"}, {"none.cfg", "cannot be read"});
    const std::string config = write_text(directory / "bad.cfg", "robot-id = 3\nno-such-key = 1\n");
    expect({"--config", config}, {config, "unknown key 'no-such-key'"});
    write_text(directory / "bad.cfg", "robot-id = x\n");
    expect({"--config", config}, {config, "robot-id = x", "[0, 32767]"});
  }
  expect_complaint({"map_daemon", "--resolution", "nan"}, {"--resolution nan", "[0, 1] m"});
  expect_complaint({"map_daemon", "--window", "10,10"}, {"--window 10,10", "three numbers"});
  expect_complaint({"map_daemon", "--horizon", "1.05"}, {"horizon", "1.05"});
  expect_complaint({"map_daemon", "--static-map", directory / "none.bt"}, {"none.bt"});
  write_text(directory / "text.bt", "this is no OctoMap\n");
  expect_complaint({"map_daemon", "--static-map", directory / "text.bt"}, {"text.bt"});
  expect_complaint({"planner_daemon", "--space-min", "0,0,0", "--space-max", "1,1,0"}, {"--space-min", "--space-max"});
  expect_complaint({"planner_daemon", "--pieces", "11"}, {"--pieces 11", "[2, 10]"});
  expect_complaint({"planner_daemon", "--v-max", "20"}, {"--pieces"});  // cannot brake within the horizon
  expect_complaint({"broadcast_daemon", "--roster", "1,,2"}, {"--roster 1,,2", "whole numbers"});
  std::string many = "0";
  for (int id = 1; id < 64; ++id) many += "," + std::to_string(id);
  expect_complaint({"broadcast_daemon", "--insecure", "true", "--roster", many}, {"--roster", "64", "60"});
  expect_complaint({"broadcast_daemon", "--insecure", "true", "--state-dir", "/dev/null/promises"},
                   {"/dev/null/promises"});
  expect_complaint({"broadcast_daemon"}, {"--key-file", "tools/new_key", "--insecure"});
  expect_complaint({"broadcast_daemon", "--key-file", "/no/such/key"}, {"/no/such/key", "tools/new_key"});
  expect_complaint({"broadcast_daemon", "--swarm-url", "udpm://239.255.76.68"}, {"--swarm-url", "port"});
}

// Option names and values that --print-config shows, in order.
std::vector<std::pair<std::string, std::string>> options_of(const std::string& config) {
  std::vector<std::pair<std::string, std::string>> options;
  std::istringstream lines(config);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t equals = line.find(" = ");
    if (line.starts_with('#')) continue;
    EXPECT_NE(equals, line.npos) << line;
    options.emplace_back(line.substr(0, equals), line.substr(equals + 3));
  }
  return options;
}

std::string on_one_line(const std::string& text) {
  std::istringstream words(text);
  std::string line;
  for (std::string word; words >> word;) line += " " + word;
  return line + " ";
}

struct ProgramWithChanges {
  Words words, changes;
};
const ProgramWithChanges kPrograms[] = {
    {{"map_daemon"}, {"--robot-id", "7", "--window", "8.5,6,3", "--margin", "0.1", "--static-map", "hall.bt"}},
    {{"planner_daemon"}, {"--lead", "0.123456789", "--space-min=-8,-8,0.2", "--pieces", "9"}},
    {{"broadcast_daemon"}, {"--roster", "3,1,2", "--swarm-url", "udpm://239.1.2.3:4000?ttl=0", "--radius", "0.3"}},
    {{"swarm_sim", "run"}, {"--mode", "processes", "--time-limit", "12.5", "--base-port", "20000"}},
    {{"swarm_sim", "world"}, {"--task", "circle", "--seed", "12", "--radius", "7.25"}}};

TEST(Options, HelpDocumentsEveryOptionWithUnitAndDefault) {
  for (const auto& [words, changes] : kPrograms) {
    Words help_words = words, config_words = words;
    help_words.push_back("--help");
    config_words.push_back("--print-config");
    const Finished help = run_program(help_words), config = run_program(config_words);
    EXPECT_EQ(help.exit_code, 0);
    EXPECT_EQ(config.exit_code, 0);
    EXPECT_EQ(help.err + config.err, "");
    const std::string text = on_one_line(help.out);
    const auto options = options_of(config.out);
    EXPECT_GE(options.size(), 7u);
    for (const auto& [name, value] : options) {
      // "--name unit (=default) what it is for; its range and unit"
      const std::size_t begin = text.find(" --" + name + " ");
      ASSERT_NE(begin, text.npos) << name << " is not in " << help.out;
      const std::string entry = text.substr(begin, text.find(" --", begin + 1) - begin);
      const std::string unit = entry.substr(name.size() + 4, entry.find(' ', name.size() + 4) - name.size() - 4);
      const std::string head = " --" + name + " " + unit + (value.empty() ? "" : " (=" + value + ")") + " ";
      EXPECT_TRUE(entry.starts_with(head)) << entry << " does not begin with " << head;
      EXPECT_GE(entry.size(), head.size() + 10) << name << " is not explained";
      if (unit == "text" || unit == "bool") continue;
      const bool plain = unit == "number" || unit == "x,y,z" || unit == "i,j,...";
      const std::size_t range = entry.find("within [");
      ASSERT_NE(range, entry.npos) << entry;
      EXPECT_NE(entry.find(plain ? "]" : "] " + unit, range), entry.npos) << entry;
    }
    for (const char* common : {"--config", "--print-config", "--version", "--help"}) {
      EXPECT_NE(text.find(std::string(" ") + common + " "), text.npos) << common;
    }
  }
  EXPECT_EQ(run_program({"swarm_sim", "--help"}).exit_code, 0);
}

TEST(Options, EveryProgramTellsItsVersionAndHowItIsUsed) {
  for (const std::string command :
       {"map_daemon", "planner_daemon", "broadcast_daemon", "mavlink_bridge", "mocap_input", "swarm_view", "swarm_hear",
        "swarm_goal", "swarm_status", "log_info", "lcm2mcap", "swarm_sim", "swarm_sim run", "swarm_sim world",
        "swarm_sim campaign", "swarm_sim merge", "swarm_sim audit"}) {
    std::istringstream words(command + " --version");
    const Finished told = run_program(Words(std::istream_iterator<std::string>(words), {}));
    EXPECT_EQ(told.exit_code, 0) << command;
    EXPECT_EQ(told.err, "") << command;
    EXPECT_EQ(told.out, command.substr(0, command.find(' ')) + " " SWARM_VERSION "\n");
    std::istringstream help_words(command + " -h");
    const Finished help = run_program(Words(std::istream_iterator<std::string>(help_words), {}));
    EXPECT_EQ(help.exit_code, 0) << command << help.err;
    EXPECT_NE(help.out.find(command), help.out.npos) << help.out;
  }
}

TEST(Options, TheShellCompletesThem) {
  const std::pair<std::string, std::string> cases[] = {{"swarm_sim ca", "campaign"},
                                                       {"swarm_sim run --state-o", "--state-outage"},
                                                       {"swarm_goal 0 --hei", "--height"},
                                                       {"map_daemon --robot-", "--robot-id"},
                                                       {"map_daemon file", ""}};
  for (const auto& [typed, completed] : cases) {
    const Finished told = run_program(
        {"/bin/bash", "-c",
         "PATH=" SWARM_BIN_DIR ":$PATH && source " SWARM_SOURCE_DIR "/tools/deploy/completion.bash && COMP_WORDS=(" +
             typed +
             ") && COMP_CWORD=$((${#COMP_WORDS[@]} - 1)) && _sogm_swarm ${COMP_WORDS[0]} && echo \"${COMPREPLY[*]}\""});
    EXPECT_EQ(told.out, completed + "\n") << typed << told.err;
  }
}

TEST(Options, PrintedConfigReadsBackTheSame) {
  TemporaryDirectory directory;
  for (const auto& [words, changes] : kPrograms) {
    Words print = words, read_back = words;
    print.insert(print.end(), changes.begin(), changes.end());
    print.push_back("--print-config");
    const Finished first = run_program(print);
    EXPECT_EQ(first.exit_code, 0) << first.err;
    const std::string file = write_text(directory / "printed.cfg", first.out);
    read_back.insert(read_back.end(), {"--config", file, "--print-config"});
    const Finished second = run_program(read_back);
    EXPECT_EQ(second.exit_code, 0) << second.err;
    EXPECT_EQ(second.out, first.out);
    Words defaults = words;
    defaults.push_back("--print-config");
    EXPECT_NE(run_program(defaults).out, first.out);
  }
}

// A daemon on buses of this test's own.
class RunningDaemon {
 public:
  explicit RunningDaemon(const std::string& name)
      : program(words(name)), onboard(local_url(base_port() + 1)), swarm(local_url(base_port())) {
    const bool listens = wait_for(10.0, [&] { return program.err().find("listens to") != std::string::npos; });
    EXPECT_TRUE(listens) << program.err();
  }
  static Words words(const std::string& name) {
    Words all = {name, "--robot-id", "1", "--onboard-url", local_url(base_port() + 1)};
    if (name == "broadcast_daemon")
      all.insert(all.end(), {"--roster", "0,1", "--insecure", "true", "--swarm-url", local_url(base_port())});
    return all;
  }

  Program program;
  LcmBus onboard, swarm;
};

TEST(Daemons, EndOnSigtermAndSigint) {
  for (const char* daemon : {"map_daemon", "planner_daemon", "broadcast_daemon"}) {
    for (const int signal : {SIGTERM, SIGINT}) {
      RunningDaemon running(daemon);
      running.program.wait(0.1);
      running.program.signal(signal);
      EXPECT_EQ(running.program.wait(kSanitized ? 10.0 : 1.0), 0) << daemon << ": " << running.program.err();
    }
  }
}

template <class Status>
void expect_garbage_is_counted(const char* daemon, const char* status_channel, const Words& onboard_channels,
                               const Words& swarm_channels = {}) {
  SCOPED_TRACE(daemon);
  RunningDaemon running(daemon);
  std::vector<Status> statuses;
  running.onboard.subscribe(status_channel, [&](std::string_view, std::span<const std::uint8_t> bytes) {
    Status status;
    ASSERT_EQ(decode(bytes, &status), Refusal::kNone);
    statuses.push_back(status);
  });
  std::mt19937 random(1);
  int sent = 0;
  const auto send_garbage = [&](LcmBus& bus, const std::string& channel) {
    for (const std::size_t size : {0, 1, 7, 8, 9, 100, 1000, 5000, 70000}) {
      Bytes bytes(size);
      for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
      EXPECT_TRUE(bus.publish(channel, bytes));
      ++sent;
    }
    std::this_thread::sleep_for(20ms);
  };
  for (const std::string& channel : onboard_channels) send_garbage(running.onboard, channel);
  for (const std::string& channel : swarm_channels) send_garbage(running.swarm, channel);
  const auto refused = [&](int i) { return statuses.empty() ? 0 : statuses.back().refused[i]; };
  const int size = static_cast<int>(Refusal::kSize), fingerprint = static_cast<int>(Refusal::kFingerprint);
  const bool counted = wait_for(5.0, [&] {
    running.onboard.drain();
    return refused(size) + refused(fingerprint) >= sent;
  });
  EXPECT_TRUE(counted) << refused(size) << " + " << refused(fingerprint) << " of " << sent;
  EXPECT_GT(refused(size), 0);
  EXPECT_GT(refused(fingerprint), 0);
  ASSERT_FALSE(statuses.empty());
  Status last = statuses.back();  // but for that, nothing has happened
  std::fill(std::begin(last.refused), std::end(last.refused), 0);
  Status idle{};
  idle.header = last.header;
  idle.state = Status{}.state + 1;  // kNoMap, kNoState
  EXPECT_EQ(encoded(last), encoded(idle));
  running.program.signal(SIGTERM);
  EXPECT_EQ(running.program.wait(kSanitized ? 10.0 : 1.0), 0) << running.program.err();
}

TEST(Daemons, CountGarbageAndGoOn) {
  using namespace sogm_swarm;
  expect_garbage_is_counted<map_status_t>("map_daemon", channel::kMapStatus,
                                          {channel::kRobotState, channel::kObstacles, channel::kObstacleVoxels});
  expect_garbage_is_counted<planner_status_t>(
      "planner_daemon", channel::kPlannerStatus,
      {channel::kSogm, channel::kOwnTrajectory, channel::kPeerTrajectory, channel::kGoal});
  expect_garbage_is_counted<broadcast_status_t>("broadcast_daemon", channel::kBroadcastStatus,
                                                {channel::kRobotState, channel::kCandidate}, {channel::kAnnouncement});
}

TEST(PlannerBench, SolvesStoredProblems) {
  TemporaryDirectory directory;
  const std::string file = directory / "problems.jsonl";
  write_text(file, qp_line("near", 1.0) + "\n" + qp_line("far", 5.0) + "\n");
  const Finished solved = run_program({"../tests/planner_bench", "--problems", file});
  EXPECT_EQ(solved.exit_code, 0) << solved.err;
  std::istringstream out(solved.out);
  std::vector<nlohmann::json> lines;
  for (std::string line; std::getline(out, line);) lines.push_back(nlohmann::json::parse(line));
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0]["name"], "near");
  EXPECT_EQ(lines[0]["status"], "solved");
  EXPECT_NEAR(lines[0]["jerk_integral"], 720.0 / 32.0, 0.03);  // the quintic from rest to rest: 720 x^2 / T^5
  EXPECT_LT(lines[0]["violation"], 1e-6);
  EXPECT_GT(lines[0]["time_us"], 0.0);
  EXPECT_EQ(lines[1]["name"], "far");
  EXPECT_EQ(lines[1]["status"], "infeasible");
  EXPECT_TRUE(lines[1]["jerk_integral"].is_null());

  write_text(file, qp_line("near", 1.0) + "\n" + replaced(qp_line("short", 1.0), "[0,1,0]", "[0,1]") + "\n");
  expect_complaint({"../tests/planner_bench", "--problems", file}, {file, "line 2", "3 components"});
  write_text(file, "");
  expect_complaint({"../tests/planner_bench", "--problems", file}, {file, "no problem"});
  const std::string none = directory / "none" / "file";
  expect_complaint({"../tests/planner_bench", "--problems", none}, {none, "cannot be read"});
  expect_complaint({"../tests/planner_bench", "--growth", none}, {none, "cannot be written"});
}

// The steps of planning on a stored set of requests, and on bad ones.
TEST(PlannerBench, TimesTheRequestsOfALog) {
  const std::string stored = SWARM_SOURCE_DIR "/tests/bench/requests/", log = stored + "20_columns.lcm";
  const Finished timed = run_program({"../tests/planner_bench", "--log", log, "--planner-config",
                                      stored + "planner.cfg", "--benchmark_filter=^(search|optimise)"});
  EXPECT_EQ(timed.exit_code, 0) << timed.err;
  for (const char* row : {"search: 20_columns", "search, per node: 20_columns", "optimise: 20_columns"})
    EXPECT_NE(timed.out.find(row), std::string::npos) << timed.out;
  EXPECT_EQ(timed.out.find("dilate"), std::string::npos);

  TemporaryDirectory directory;
  const std::string empty = directory / "empty.lcm";
  write_text(empty, "");
  expect_complaint({"../tests/planner_bench", "--log", empty}, {empty, "no map"});
  expect_complaint({"../tests/planner_bench", "--log", directory / "none"}, {"none", "cannot be opened"});
  expect_complaint({"../tests/planner_bench", "--log", log, "--planner-config", directory / "none"}, {"none"});
  expect_complaint({"../tests/planner_bench", "--speed", "1"}, {"speed"});
}

}  // namespace
}  // namespace swarm::test
