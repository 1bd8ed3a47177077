// Options: three sources and their order, round trip through a config file, and one clear line for whatever is wrong.
#include "lcmtypes/bus/option_set.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <random>
#include <sstream>

namespace swarm {
namespace {

struct Config {
  double resolution = 0.1;
  int threads = 2;
  Eigen::Vector3d window{10, 10, 4};
  std::vector<int> peers{1, 2};
  std::string map_file = "office.bt";
  bool noise = false;
  std::string world;
};

OptionSet options_of(Config& config) {
  OptionSet options("tester", "Tries options.");
  options.add("resolution", &config.resolution, 0.01, 1.0, "m", "edge of a voxel");
  options.add("threads", &config.threads, 1, 64, "", "workers");
  options.add("window", &config.window, 1.0, 100.0, "m", "size of the map");
  options.add("peers", &config.peers, 0, 32767, "ids of the other robots");
  options.add("map-file", &config.map_file, "static map", [](const std::string& text) {
    if (!text.empty() && !text.ends_with(".bt")) throw OptionError("must end in .bt");
  });
  options.add("noise", &config.noise, "disturb the sensors");
  return options;
}

struct Outcome {
  Config config;
  OptionSet::Parsed parsed = OptionSet::Parsed::kRun;
  std::string out, error;
};

Outcome run(std::vector<const char*> words, bool positional = false) {
  Outcome outcome;
  OptionSet options = options_of(outcome.config);
  if (positional) options.add_positional("WORLD", &outcome.config.world, "world file");
  words.insert(words.begin(), "tester");
  std::ostringstream out;
  try {
    outcome.parsed = options.parse(static_cast<int>(words.size()), words.data(), out);
  } catch (const OptionError& error) {
    outcome.error = error.what();
  }
  outcome.out = out.str();
  return outcome;
}

class ConfigFile {
 public:
  explicit ConfigFile(const std::string& text) { std::ofstream(path_) << text; }
  ~ConfigFile() { std::remove(path_.c_str()); }
  const char* path() const { return path_.c_str(); }

 private:
  std::string path_ = testing::TempDir() + testing::UnitTest::GetInstance()->current_test_info()->name() + ".cfg";
};

std::string config_error(const std::string& text) {
  const ConfigFile file(text);
  const std::string error = run({"--config", file.path()}).error, prefix = std::string(file.path()) + ": ";
  EXPECT_TRUE(error.starts_with(prefix)) << error;
  return error.substr(std::min(prefix.size(), error.size()));
}

TEST(OptionSet, TakesAnyNumberOfLastArguments) {
  const auto logs_of = [](std::vector<const char*> words) {
    Config config;
    std::vector<std::string> logs;
    OptionSet options = options_of(config);
    options.add_positional("WORLD", &config.world, "world file");
    options.add_positional("LOG", &logs, "log file");
    words.insert(words.begin(), "tester");
    std::ostringstream out;
    options.parse(static_cast<int>(words.size()), words.data(), out);
    logs.insert(logs.begin(), config.world);
    return logs;
  };
  using Words = std::vector<std::string>;
  EXPECT_EQ(logs_of({"city.json"}), (Words{"city.json"}));
  EXPECT_EQ(logs_of({"city.json", "a.lcm", "--threads", "3", "b.lcm"}), (Words{"city.json", "a.lcm", "b.lcm"}));
  EXPECT_EQ(logs_of({"city.json", "-3,2,1", "-.5"}), (Words{"city.json", "-3,2,1", "-.5"}));  // numbers, no options
  EXPECT_THROW(logs_of({}), OptionError);
  EXPECT_THROW(logs_of({"city.json", ""}), OptionError);
}

TEST(OptionSet, ReadsEveryKind) {
  const Outcome outcome = run({"--resolution", "0.25", "--threads=3", "--window", "1,2.5, 3e1", "--peers", "7,0,32767",
                               "--map-file", "a b.bt", "--noise", "true"});
  ASSERT_EQ(outcome.error, "");
  EXPECT_EQ(outcome.parsed, OptionSet::Parsed::kRun);
  EXPECT_EQ(outcome.config.resolution, 0.25);
  EXPECT_EQ(outcome.config.threads, 3);
  EXPECT_EQ(outcome.config.window, Eigen::Vector3d(1, 2.5, 30));
  EXPECT_EQ(outcome.config.peers, (std::vector<int>{7, 0, 32767}));
  EXPECT_EQ(outcome.config.map_file, "a b.bt");
  EXPECT_TRUE(outcome.config.noise);
}

TEST(OptionSet, KeepsDefaultsAndTakesEmptyTextAndLists) {
  EXPECT_EQ(run({}).config.peers, (std::vector<int>{1, 2}));
  for (const auto& words : {std::vector{"--peers=", "--map-file="}, {"--peers", "", "--map-file", ""}}) {
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.error, "");
    EXPECT_TRUE(outcome.config.peers.empty());
    EXPECT_EQ(outcome.config.map_file, "");
    EXPECT_EQ(outcome.config.resolution, 0.1);
  }
}

TEST(OptionSet, CommandLineWinsOverConfigOverDefaults) {
  const ConfigFile file("# a comment\n\n resolution = 0.5  # coarse\nthreads=8\npeers =\n");
  const Outcome outcome = run({"--threads", "9", "--config", file.path()});
  ASSERT_EQ(outcome.error, "");
  EXPECT_EQ(outcome.config.resolution, 0.5);
  EXPECT_EQ(outcome.config.threads, 9);
  EXPECT_TRUE(outcome.config.peers.empty());
  EXPECT_EQ(outcome.config.window, Eigen::Vector3d(10, 10, 4));
}

TEST(OptionSet, SaysWhatIsWrongOnTheCommandLine) {
  EXPECT_EQ(run({"--resolution", "-1"}).error, "--resolution -1: must be within [0.01, 1] m");
  EXPECT_EQ(run({"--resolution=1.01"}).error, "--resolution 1.01: must be within [0.01, 1] m");
  for (const char* text : {"nan", "inf", "", "0.1m", "0,1", "1e999", " 0.1"}) {
    EXPECT_EQ(run({"--resolution", text}).error, "--resolution " + std::string(text) + ": must be within [0.01, 1] m");
  }
  for (const char* text : {"0", "65", "2.5", "99999999999", "x", ""}) {
    EXPECT_EQ(run({"--threads", text}).error,
              "--threads " + std::string(text) + ": must be a whole number within [1, 64]");
  }
  for (const char* text : {"1,2", "1,2,3,4", "1,2,x", "1,2,", "1,2,0.5", ""}) {
    EXPECT_EQ(run({"--window", text}).error,
              "--window " + std::string(text) + ": must be three numbers x,y,z, each within [1, 100] m");
  }
  for (const char* text : {"1,,2", ",", "-1", "32768"}) {
    EXPECT_EQ(run({"--peers", text}).error,
              "--peers " + std::string(text) + ": must be whole numbers separated by commas, each within [0, 32767]");
  }
  EXPECT_EQ(run({"--noise", "yes"}).error, "--noise yes: must be true or false");
  EXPECT_EQ(run({"--map-file", "map.txt"}).error, "--map-file map.txt: must end in .bt");
  EXPECT_NE(run({"--map-file", "a#b.bt"}).error, "");
  EXPECT_EQ(run({"--foo"}).error, "unknown option '--foo'");
  EXPECT_EQ(run({"--foo=3"}).error, "unknown option '--foo'");
  EXPECT_EQ(run({"--reso", "0.2"}).error, "unknown option '--reso'");  // no guessing
  EXPECT_EQ(run({"-x"}).error, "unknown option '-x'");
  EXPECT_EQ(run({"-"}).error, "unknown option '-'");
  EXPECT_EQ(run({"stray"}).error, "unexpected argument 'stray' (see --help)");
  EXPECT_EQ(run({"--threads", "3", "--threads", "3"}).error, "--threads: given twice");
  EXPECT_EQ(run({"--config", "/no/such.cfg"}).error, "/no/such.cfg: cannot be read");
  EXPECT_EQ(run({"--config", "/"}).error, "/: cannot be read");
  EXPECT_NE(run({"--threads"}).error.find("--threads"), std::string::npos);
}

TEST(OptionSet, SaysWhatIsWrongInAConfigFile) {
  EXPECT_EQ(config_error("foo = 1\n"), "unknown key 'foo'");
  EXPECT_EQ(config_error("config = other.cfg\n"), "unknown key 'config'");
  EXPECT_EQ(config_error("[part]\nthreads = 3\n"), "unknown key 'part.threads'");
  EXPECT_EQ(config_error("threads = 0\n"), "threads = 0: must be a whole number within [1, 64]");
  EXPECT_EQ(config_error("threads = 2\nthreads = 3\n"), "threads: given twice");
  EXPECT_EQ(config_error("threads\n"), "'threads' is not of the form: name = value");
}

TEST(OptionSet, AConfigFileIsCheckedEvenWhereTheCommandLineWins) {
  const ConfigFile file("threads = 0\n");
  EXPECT_NE(run({"--config", file.path(), "--threads", "3"}).error, "");
}

TEST(OptionSet, HelpShowsUnitRangeAndDefault) {
  const Outcome outcome = run({"--help"}, true);  // though WORLD is missing
  EXPECT_EQ(outcome.error, "");
  EXPECT_EQ(outcome.parsed, OptionSet::Parsed::kExit);
  for (const char* part :
       {"Usage: tester [options] WORLD", "Tries options.", "WORLD: world file", "--resolution m (=0.1)",
        "edge of a voxel; within [0.01, 1] m", "--peers i,j,... (=1,2)", "--window x,y,z (=10,10,4)",
        "--noise bool (=false)", "--config file", "--print-config", "--version"}) {
    EXPECT_NE(outcome.out.find(part), std::string::npos) << part << "\n" << outcome.out;
  }
}

TEST(OptionSet, VersionIsOneLine) {
  const Outcome outcome = run({"--threads", "0", "--version"}, true);  // though WORLD is missing and threads are wrong
  EXPECT_EQ(outcome.error, "");
  EXPECT_EQ(outcome.parsed, OptionSet::Parsed::kExit);
  EXPECT_EQ(outcome.out, version_line("tester") + "\n");
  EXPECT_EQ(version_line("tester command"), version_line("tester"));
  EXPECT_EQ(config_error("version = 1\n"), "unknown key 'version'");
}

TEST(OptionSet, PrintedConfigReadsBackAsTheSame) {
  std::mt19937_64 random(1);
  for (int i = 0; i < 200; ++i) {
    const auto real = [&random](double low, double high) {
      return std::to_string(std::uniform_real_distribution<double>(low, high)(random));
    };
    const std::string resolution = real(0.01, 1), window = real(1, 99) + "," + real(1, 99) + "," + real(1, 99);
    const std::string peers = i % 3 == 0 ? "" : std::to_string(i) + ",5", map = i % 2 == 0 ? "" : "m=p \"1\".bt";
    const std::vector words{
        "--resolution", resolution.c_str(), "--window",  window.c_str(), "--peers",
        peers.c_str(),  "--map-file",       map.c_str(), "--noise",      i % 2 == 0 ? "true" : "false"};
    const Outcome direct = run(words);
    ASSERT_EQ(direct.error, "");
    auto printing = words;
    printing.push_back("--print-config");
    const Outcome printed = run(printing);
    ASSERT_EQ(printed.parsed, OptionSet::Parsed::kExit);
    const ConfigFile file(printed.out);
    const Outcome read = run({"--config", file.path()});
    ASSERT_EQ(read.error, "") << printed.out;
    EXPECT_EQ(read.config.resolution, direct.config.resolution);
    EXPECT_EQ(read.config.window, direct.config.window);
    EXPECT_EQ(read.config.peers, direct.config.peers);
    EXPECT_EQ(read.config.map_file, direct.config.map_file);
    EXPECT_EQ(read.config.noise, direct.config.noise);
    EXPECT_EQ(run({"--config", file.path(), "--print-config"}).out, printed.out);
  }
}

TEST(OptionSet, PositionalArgumentsAreRequiredAndOnlyPositional) {
  EXPECT_EQ(run({"city.json", "--threads", "3"}, true).config.world, "city.json");
  EXPECT_EQ(run({"--threads", "3"}, true).error, "argument WORLD is missing (see --help)");
  EXPECT_EQ(run({"--WORLD", "city.json"}, true).error, "unknown option '--WORLD'");
  EXPECT_EQ(run({"a", "b"}, true).error, "unexpected argument 'b' (see --help)");
  EXPECT_EQ(run({"--print-config"}, true).out.find("WORLD"), std::string::npos);
}

}  // namespace
}  // namespace swarm
