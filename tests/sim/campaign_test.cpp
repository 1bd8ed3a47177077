// Campaigns: rows, resuming, shards, lists of worlds; and a small fixed campaign whose success rate is held. Long
// because each way to lose rows or to fly a trial twice (kills, locks, full disks, torn lines) is tried.
#include "swarm_sim/campaign/campaign.h"

#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <zlib.h>

#include <array>
#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <random>
#include <set>

#include "swarm_sim/campaign/usable_cores.h"
#include "swarm_sim/results/csv.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"
#include "swarm_sim/world/world_list.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;
using Cells = std::vector<std::string>;

TEST(Csv, RoundTripsAnyCells) {
  for (const Cells& cells : {Cells{""}, Cells{"", ""}, Cells{"a", "b c"}, Cells{"a,b", "\"", "say \"x\", y", "'"}})
    EXPECT_EQ(csv_cells(csv_line(cells)), cells);
  EXPECT_EQ(csv_line({"a,b", "c\"d", "e"}), "\"a,b\",\"c\"\"d\",e");
  EXPECT_THROW(csv_line({"two\nlines"}), std::invalid_argument);
  EXPECT_THROW(csv_cells("\"open"), std::invalid_argument);
}

World small_world(int seed) {
  return make_world(Task::kCircle, Environment::kPure, 1, static_cast<std::uint64_t>(seed),
                    {.robots = 2, .circle_m = 1.5});
}

std::string one_line(const World& world) {
  std::string text = to_json_text(world, "");
  std::erase(text, '\n');
  return text;
}

fs::path write_gzip(const fs::path& path, const std::string& text) {
  const gzFile out = gzopen(path.c_str(), "wb");
  gzwrite(out, text.data(), static_cast<unsigned>(text.size()));
  gzclose(out);
  return path;
}

TEST(WorldList, ReadsADirectoryInTheOrderOfTheNames) {
  TemporaryDirectory directory;
  write_text(directory / "b.json", one_line(small_world(2)));
  write_text(directory / "a.json", one_line(small_world(1)));
  write_text(directory / "notes.txt", "no world");
  const auto worlds = read_listed_worlds(directory.path());
  ASSERT_EQ(worlds.size(), 2u);
  EXPECT_EQ(worlds[0].place, (directory / "a.json").string());
  EXPECT_EQ(read_listed_world(worlds[0].place), small_world(1));
  EXPECT_EQ(listed_trial(worlds[1].text, worlds[1].place).world(), small_world(2));
}

TEST(WorldList, ReadsPlainAndCompressedLines) {
  TemporaryDirectory directory;
  const std::string text = one_line(small_world(1)) + "\n\n" + one_line(small_world(2));
  for (const fs::path& list : {write_text(directory / "w.jsonl", text), write_gzip(directory / "w.jsonl.gz", text)}) {
    const auto lines = read_listed_worlds(list);
    ASSERT_EQ(lines.size(), 2u);
    EXPECT_EQ(lines[1].place, list.string() + ":3");
    EXPECT_EQ(read_listed_world(list.string() + ":1"), small_world(1));
    EXPECT_EQ(read_listed_world(list.string() + ":3"), small_world(2));
    EXPECT_THROW(read_listed_world(list.string() + ":2"), WorldError);
    EXPECT_THROW(read_listed_world(list.string() + ":0"), WorldError);
  }
  EXPECT_THROW(read_listed_worlds(directory / "none.jsonl"), WorldError);
  EXPECT_THROW(read_listed_worlds(directory.path()), WorldError);  // no world files
  EXPECT_THROW(read_listed_worlds(write_text(directory / "empty.jsonl", "\n \n")), WorldError);
  const std::string whole = read_text(directory / "w.jsonl.gz");
  EXPECT_THROW(read_listed_worlds(write_text(directory / "torn.jsonl.gz", whole.substr(0, whole.size() / 2))),
               WorldError);
}

class Campaign : public testing::Test {
 protected:
  Campaign() {
    write_text(list_, one_line(small_world(1)) + "\n" + one_line(small_world(2)) + "\n" + one_line(small_world(3)));
  }
  Finished run(Cells more) const {
    Cells words = {"swarm_sim", "campaign", "--worlds", list_};
    words.insert(words.end(), more.begin(), more.end());
    return run_program(words, 60);
  }
  static std::set<std::string> trials(const fs::path& path) {
    std::set<std::string> names;
    for (const TrialRow& row : read_results(path)) EXPECT_TRUE(names.insert(cell(row, "trial")).second);
    return names;
  }
  TemporaryDirectory directory_;
  fs::path list_ = directory_ / "small.jsonl", out_ = directory_ / "results.csv";
};

TEST_F(Campaign, ShardsCoverAllTrialsOnceAndMerge) {
  const fs::path a = directory_ / "a.csv", b = directory_ / "b.csv";
  EXPECT_EQ(run({"--shard", "1/2", "--out", a}).exit_code, 0);
  EXPECT_EQ(run({"--shard", "2/2", "--out", b}).exit_code, 0);
  EXPECT_EQ(trials(a), (std::set<std::string>{list_.string() + ":1", list_.string() + ":3"}));
  EXPECT_EQ(trials(b), (std::set<std::string>{list_.string() + ":2"}));
  const Finished merged = run_program({"swarm_sim", "merge", b, a, a, "-o", out_});
  EXPECT_EQ(merged.exit_code, 0) << merged.err;
  EXPECT_NE(merged.out.find("circle pure 1"), std::string::npos) << merged.out;
  const auto rows = read_results(out_);
  ASSERT_EQ(rows.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(cell(rows[i], "trial"), list_.string() + ":" + std::to_string(i + 1));
    EXPECT_EQ(cell(rows[i], "outcome"), "success");
    EXPECT_EQ(cell(rows[i], "task"), "circle");
    EXPECT_EQ(cell(rows[i], "env"), "pure");
    EXPECT_EQ(cell(rows[i], "obstacles"), "1");
    EXPECT_EQ(cell(rows[i], "seed"), std::to_string(i + 1));
    EXPECT_GT(std::stod(cell(rows[i], "last_arrival_s")), 1.0);
    EXPECT_LE(std::stod(cell(rows[i], "max_speed_ratio")), 1.01);
    EXPECT_LE(std::stod(cell(rows[i], "max_acceleration_ratio")), 1.01);
    EXPECT_LT(std::stod(cell(rows[i], "max_position_jump_m")), 1e-3);
    EXPECT_GT(std::stod(cell(rows[i], "total_p50_ms")), 0.0);
    EXPECT_GT(std::stod(cell(rows[i], "map_p50_ms")), 0.0);
    EXPECT_GT(std::stod(cell(rows[i], "commit_p99_ms")), 0.0);
    EXPECT_GT(std::stod(cell(rows[i], "received_hz")), 10.0);
    EXPECT_GT(std::stod(cell(rows[i], "datagram_bytes")), 100.0);
    EXPECT_GT(std::stod(cell(rows[i], "airtime_6mbps")), std::stod(cell(rows[i], "airtime_24mbps")));
    EXPECT_GT(std::stod(cell(rows[i], "busiest_airtime_24mbps")), 0.0);
    EXPECT_EQ(cell(rows[i], "collided_share"), "");  // there is no channel
    EXPECT_EQ(cell(rows[i], "command"), "swarm_sim run " + cell(rows[i], "trial") + " --out trial");
  }
  // Files that disagree about a trial are not joined.
  std::string other = read_text(a);
  other.replace(other.find(",success,"), 9, ",timeout,");
  write_text(b, other);
  const Finished refused = run_program({"swarm_sim", "merge", a, b, "-o", directory_ / "no.csv"});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("outcome 'timeout' must be 'success'"), std::string::npos) << refused.err;
  EXPECT_FALSE(fs::exists(directory_ / "no.csv"));
}

TEST_F(Campaign, MergeSaysWhichPartsLackTrials) {
  const fs::path a = directory_ / "a.csv", b = directory_ / "b.csv";
  ASSERT_EQ(run({"--shard", "1/2", "--out", a}).exit_code, 0);
  ASSERT_EQ(run({"--shard", "2/2", "--out", b}).exit_code, 0);
  const auto merge = [&](const std::string& expected) {
    return run_program({"swarm_sim", "merge", a, b, "-o", out_, "--expect", expected});
  };
  const auto refused = [&](const std::string& expected, const std::string& text) {
    const Finished finished = merge(expected);
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_NE(finished.err.find(text), std::string::npos) << finished.err;
    EXPECT_FALSE(fs::exists(out_));
  };
  refused("4", "expect: 3 trials are there; must be 4; fewer than 2 of them are in " + b.string() + " (1)\n");
  refused("2", "expect: 3 trials are there; must be 2\n");
  for (const char* number : {"", "0", "-3", "3x", "2.5"})
    refused(number, "expect: '" + std::string(number) + "' must be a number of trials from 1 on\n");
  EXPECT_EQ(merge("3").exit_code, 0);
  EXPECT_EQ(trials(out_).size(), 3u);
}

// Slurm takes a computer for lost, starts its shard elsewhere, and the process lives.
TEST_F(Campaign, WaitsForTheOneThatWritesAndGoesOnWhenThatIsKilled) {
  std::string worlds;
  for (int seed = 1; seed <= 30; ++seed) worlds += one_line(small_world(seed)) + "\n";
  write_text(list_, worlds);
  const Cells command = {"swarm_sim", "campaign", "--worlds", list_, "--out", out_, "--jobs", "1"};
  const auto rows_there = [&] {
    const std::string text = fs::exists(out_) ? read_text(out_) : "";
    return std::max<std::ptrdiff_t>(std::ranges::count(text, '\n') - 1, 0);
  };
  Program lost(command);
  ASSERT_TRUE(wait_for(20 * kPatience, [&] { return rows_there() > 0; })) << lost.err();
  lost.signal(SIGSTOP);
  std::this_thread::sleep_for(50ms);  // a signal to another process takes effect soon
  const auto flown = rows_there();
  ASSERT_LT(flown, 30);
  Program second(command);
  const std::string said = "campaign: another campaign is writing " + out_.string() +
                           " (rows so far: " + std::to_string(flown) + "); waiting until it ends\n";
  ASSERT_TRUE(wait_for(10 * kPatience, [&] { return second.err() == said; })) << second.err();
  EXPECT_FALSE(second.wait(0.5)) << second.err();
  EXPECT_EQ(second.err(), said) << "is said once";
  std::ofstream(out_, std::ios::app) << "small.jsonl:" << flown + 1 << ",circle,pu";  // killed amid a row
  lost.signal(SIGKILL);
  ASSERT_EQ(second.wait(60 * kPatience), 0) << second.err();
  EXPECT_NE(second.err().find("30 trials, " + std::to_string(flown) + " of them already"), std::string::npos)
      << second.err();
  EXPECT_EQ(trials(out_).size(), 30u);
}

TEST_F(Campaign, WhoWaitsCanBeEnded) {
  const ResultsFile held(out_);
  Program waiting({"swarm_sim", "campaign", "--worlds", list_, "--out", out_});
  ASSERT_TRUE(wait_for(10 * kPatience, [&] { return !waiting.err().empty(); }));
  waiting.signal(SIGTERM);
  EXPECT_EQ(waiting.wait(5 * kPatience), -SIGTERM) << waiting.err();
}

// A file system without locks.
TEST_F(Campaign, ALockThatCannotBeHadIsNamed) {
  if (::prctl(PR_GET_SECCOMP) < 0) GTEST_SKIP() << "needs seccomp";
  const auto open_without_locks = [&] {
    std::array<sock_filter, 4> rules = {{BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
                                         BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_flock, 0, 1),
                                         BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOLCK),
                                         BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)}};
    const sock_fprog program = {.len = rules.size(), .filter = rules.data()};
    ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
    ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
    try {
      const ResultsFile results(out_);
    } catch (const std::runtime_error& error) {
      std::cerr << error.what();
      ::_exit(2);
    }
    ::_exit(0);
  };
  EXPECT_EXIT(open_without_locks(), testing::ExitedWithCode(2),
              "^" + out_.string() + ": cannot be locked: No locks available$");
}

TEST_F(Campaign, ARowForWhichThereIsNoRoomIsNamedAndFlownAgain) {
  ASSERT_EQ(run({"--out", out_}).exit_code, 0);
  const auto rows = read_results(out_);
  const fs::path full = directory_ / "full.csv";
  {
    ResultsFile results(full);
    results.append(rows[0]);
    const auto size = fs::file_size(full);
    rlimit limit{};
    ::getrlimit(RLIMIT_FSIZE, &limit);
    const rlimit lower = {.rlim_cur = size + 10, .rlim_max = limit.rlim_max};
    const auto handler = std::signal(SIGXFSZ, SIG_IGN);
    ::setrlimit(RLIMIT_FSIZE, &lower);
    std::string error;
    try {
      results.append(rows[1]);
    } catch (const std::runtime_error& thrown) {
      error = thrown.what();
    }
    ::setrlimit(RLIMIT_FSIZE, &limit);
    std::signal(SIGXFSZ, handler);
    EXPECT_EQ(error, full.string() + ": cannot be written: File too large");
    EXPECT_EQ(fs::file_size(full), size + 10);
  }
  ResultsFile results(full);
  EXPECT_EQ(results.rows(), std::vector<TrialRow>{rows[0]});
  results.append(rows[1]);
  EXPECT_EQ(read_results(full), (std::vector<TrialRow>{rows[0], rows[1]}));
}

// This thread's cores are again what they were when this ends, and Slurm says nothing before and after.
class Cores : public testing::Test {
 protected:
  Cores() {
    ::sched_getaffinity(0, sizeof mask_, &mask_);
    set("SLURM_CPUS_PER_TASK", nullptr), set("SLURM_CPUS_ON_NODE", nullptr);
  }
  ~Cores() override {
    ::sched_setaffinity(0, sizeof mask_, &mask_);
    set("SLURM_CPUS_PER_TASK", nullptr), set("SLURM_CPUS_ON_NODE", nullptr);
  }
  static void set(const char* variable, const char* text) {
    text == nullptr ? ::unsetenv(variable) : ::setenv(variable, text, 1);
  }
  cpu_set_t mask_{};
};

TEST_F(Cores, AreThoseThatItMayRunOn) {
  EXPECT_EQ(usable_cores(), CPU_COUNT(&mask_));
  cpu_set_t one{};
  for (std::size_t i = 0; CPU_COUNT(&one) == 0; ++i) {
    if (CPU_ISSET(i, &mask_)) CPU_SET(i, &one);
  }
  ASSERT_EQ(::sched_setaffinity(0, sizeof one, &one), 0);
  EXPECT_EQ(usable_cores(), 1);
  set("SLURM_CPUS_PER_TASK", "8");  // what is granted twice over does not run faster
  EXPECT_EQ(usable_cores(), 1);
}

TEST_F(Cores, AreNoMoreThanSlurmGives) {
  const int all = CPU_COUNT(&mask_);
  set("SLURM_CPUS_ON_NODE", "1");
  EXPECT_EQ(usable_cores(), 1);
  set("SLURM_CPUS_PER_TASK", std::to_string(all).c_str());  // a task is told apart from its job
  EXPECT_EQ(usable_cores(), all);
  for (const char* text : {"", "0", "-1", "two", "1.5"}) {
    set("SLURM_CPUS_PER_TASK", text);
    try {
      (void)usable_cores();
      ADD_FAILURE() << "'" << text << "' was taken";
    } catch (const std::runtime_error& error) {
      EXPECT_EQ(error.what(), "SLURM_CPUS_PER_TASK: '" + std::string(text) + "' must be a number from 1 on");
    }
  }
}

TEST_F(Campaign, FliesAsManyAtATimeAsSlurmGivesCores) {
  ::setenv("SLURM_CPUS_ON_NODE", "1", 1);
  const Finished flown = run({"--out", out_});
  ::unsetenv("SLURM_CPUS_ON_NODE");
  EXPECT_EQ(flown.exit_code, 0) << flown.err;
  EXPECT_NE(flown.err.find(", 1 at a time\n"), std::string::npos) << flown.err;
}

TEST_F(Campaign, FliesTheWorldFilesOfADirectory) {
  const fs::path worlds = directory_ / "worlds";
  fs::create_directory(worlds);
  for (const int seed : {1, 2}) write_text(worlds / (std::to_string(seed) + ".json"), one_line(small_world(seed)));
  const Finished flown = run_program({"swarm_sim", "campaign", "--worlds", worlds, "--out", out_}, 60);
  EXPECT_EQ(flown.exit_code, 0) << flown.err;
  EXPECT_EQ(trials(out_), (std::set<std::string>{worlds / "1.json", worlds / "2.json"}));
  const Finished refused = run_program({"swarm_sim", "campaign", "--worlds", worlds / "1.json", "--out", out_}, 60);
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("must end in .jsonl or .jsonl.gz, or be a directory"), std::string::npos) << refused.err;
}

TEST_F(Campaign, GoesOnWhereItWasAfterATornLine) {
  ASSERT_EQ(run({"--out", out_, "--jobs", "1"}).exit_code, 0);
  const std::string whole = read_text(out_);
  const std::size_t second = whole.find('\n', whole.find('\n') + 1) + 1;
  write_text(out_, whole.substr(0, second + 40));  // header, a row, a torn row
  const Finished resumed = run({"--out", out_});
  EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_NE(resumed.err.find("3 trials, 1 of them already"), std::string::npos) << resumed.err;
  EXPECT_EQ(read_text(out_).substr(0, second), whole.substr(0, second));
  EXPECT_EQ(trials(out_).size(), 3u);
  const std::string done = read_text(out_);
  EXPECT_EQ(run({"--out", out_}).exit_code, 0);  // nothing left to fly
  EXPECT_EQ(read_text(out_), done);
}

TEST_F(Campaign, TheReportSaysTheSameAsTheResults) {
  const std::string report = std::string(SWARM_SOURCE_DIR) + "/tools/report";
  ASSERT_EQ(run({"--out", out_}).exit_code, 0);
  std::string results = read_text(out_);
  const std::size_t at = results.rfind(",success,,");
  results.replace(at, 10, ",collision,robot 1-robot 0@3.00,");
  write_text(out_, results);
  const Finished drawn = run_program({report, out_}, 60);
  ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
  const std::string page = read_text(directory_ / "results" / "report.html");
  EXPECT_NE(page.find("<h1>3 flights, 66.7 % success</h1>"), std::string::npos);
  EXPECT_NE(page.find("1 failures"), std::string::npos);
  EXPECT_NE(page.find("robot 1-robot 0@3.00"), std::string::npos);
  EXPECT_NE(page.find("swarm_sim run " + list_.string() + ":"), std::string::npos);
  EXPECT_EQ(page.find("src="), std::string::npos) << "must be self-contained";
  std::size_t figure = 0;
  for (const char* name : {"success", "flight_time", "planning_time"}) {
    EXPECT_GT(fs::file_size(directory_ / "results" / (std::string(name) + ".png")), 5000u);
    figure = page.find("<figure>", figure + 1);
    ASSERT_NE(figure, std::string::npos) << name;
    EXPECT_LT(page.find("<svg", figure), page.find("</figure>", figure)) << name;
  }
  write_text(out_, results.replace(results.find("obstacles"), 9, "obstacle_"));
  const Finished refused = run_program({report, out_, "--out", directory_ / "none"}, 60);
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("results.csv: line 1: column obstacles is missing"), std::string::npos) << refused.err;
  EXPECT_EQ(run_program({report}).exit_code, 2);
  EXPECT_EQ(run_program({report, directory_ / "none.csv"}).exit_code, 2);
}

TEST_F(Campaign, TheRowsCommandRepeatsTheTrial) {
  ASSERT_EQ(run({"--out", out_, "--time-limit", "1.5"}).exit_code, 0);
  const auto rows = read_results(out_);
  EXPECT_EQ(cell(rows[0], "outcome"), "timeout");
  const std::string command = cell(rows[0], "command");
  EXPECT_NE(command.find(" --time-limit 1.5"), std::string::npos) << command;
  Cells words;
  std::istringstream in(command);
  for (std::string word; in >> word;) words.push_back(word);
  words[4] = directory_ / "trial";
  EXPECT_EQ(run_program(words).exit_code, 1);
  EXPECT_TRUE(fs::exists(directory_ / "trial" / "report.json"));
}

TEST_F(Campaign, BadInputIsRefusedAndNothingIsTouched) {
  const auto expect = [&](const Cells& options, const Cells& texts) {
    const Finished finished = run(options);
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_EQ(std::count(finished.err.begin(), finished.err.end(), '\n'), 1) << finished.err;
    for (const std::string& text : texts) EXPECT_NE(finished.err.find(text), std::string::npos) << finished.err;
  };
  expect({}, {"out", "must be given"});
  expect({"--out", out_, "--shard", "0/2"}, {"shard", "'0/2' must be i/n"});
  expect({"--out", out_, "--shard", "3/2"}, {"shard", "'3/2' must be i/n"});
  expect({"--out", out_, "--shard", "1/2x"}, {"shard", "'1/2x' must be i/n"});
  expect({"--out", out_, "--jobs", "-1"}, {"--jobs -1"});
  expect({"--out", directory_ / "none" / "r.csv"}, {"r.csv", "cannot be written"});
  EXPECT_FALSE(fs::exists(out_));
  write_text(out_, "t,robot,x\n0,0,1\n");
  expect({"--out", out_}, {"results.csv", "line 1", "columns"});
  EXPECT_EQ(read_text(out_), "t,robot,x\n0,0,1\n");
  write_text(out_, "not a results file");
  expect({"--out", out_}, {"results.csv", "line 1", "columns"});
  EXPECT_EQ(read_text(out_), "not a results file");
  write_text(list_, "{\"name\": 1}");
  fs::remove(out_);
  expect({"--out", out_}, {list_.string() + ":1", "name"});
  const Finished tasks = run_program({"swarm_sim", "campaign", "--tasks", "cross,sideways", "--out", out_}, 10);
  EXPECT_EQ(tasks.exit_code, 2);
  EXPECT_NE(tasks.err.find("sideways"), std::string::npos) << tasks.err;
  EXPECT_FALSE(fs::exists(out_));
}

TEST_F(Campaign, OtherOptionsDoNotMixWithResultsAlreadyThere) {
  ASSERT_EQ(run({"--out", out_}).exit_code, 0);
  const Finished mixed = run({"--out", out_, "--sensor-rate", "10"});
  EXPECT_EQ(mixed.exit_code, 2);
  EXPECT_NE(mixed.err.find("was flown with other options"), std::string::npos) << mixed.err;
}

TEST_F(Campaign, ObstaclesMayAccelerate) {
  const Cells command = {"swarm_sim", "campaign", "--tasks", "circle", "--envs",   "pure", "--obstacles",  "1",
                         "--trials",  "1",        "--out",   out_,     "--robots", "2",    "--time-limit", "0.5"};
  Cells accelerating = command;
  accelerating.insert(accelerating.end(), {"--obstacle-acceleration", "1"});
  const Finished flown = run_program(accelerating, 60);
  ASSERT_EQ(flown.exit_code, 0) << flown.err;
  const Trial trial = seeded_trial("circle", "pure", 1, 1, {.robots = 2, .obstacle_acceleration_mps2 = 1.0});
  EXPECT_EQ(trial.world().obstacles.at(0).acceleration_mps2, 1.0);
  const auto rows = read_results(out_);
  ASSERT_EQ(rows.size(), 1u);
  FlightArguments arguments;
  arguments.time_limit_s = 0.5;
  EXPECT_EQ(cell(rows[0], "command"), trial.command(arguments));
  EXPECT_NE(cell(rows[0], "command").find(" --obstacle-acceleration 1 -o trial.json && "), std::string::npos)
      << cell(rows[0], "command");
  const Finished mixed = run_program(command, 60);
  EXPECT_EQ(mixed.exit_code, 2);
  EXPECT_NE(mixed.err.find("was flown with other options"), std::string::npos) << mixed.err;
}

// The planner's success among many obstacles: a regression shows here before a long campaign does.
TEST(CampaignSuccess, ASmallFixedCampaignSucceeds) {
  TemporaryDirectory directory;
  std::vector<Trial> trials;
  for (const char* task : {"cross", "bilateral", "unilateral"}) {
    for (const char* environment : {"pure", "mixed"}) {
      for (int seed : {501, 502}) trials.push_back(seeded_trial(task, environment, 30, seed));
    }
  }
  ResultsFile results(directory / "results.csv");
  ASSERT_TRUE(fly_campaign(
      trials, {}, 2, results, [] { return true; }, [](const TrialRow&) {}));
  int successes = 0;
  double last_s = 0.0;
  for (const TrialRow& row : results.rows()) {
    EXPECT_EQ(cell(row, "touches").find("-robot "), std::string::npos) << cell(row, "trial");
    EXPECT_LE(std::stod(cell(row, "max_speed_ratio")), 1.01);
    EXPECT_LE(std::stod(cell(row, "max_acceleration_ratio")), 1.01);
    EXPECT_LT(std::stod(cell(row, "max_position_jump_m")), 1e-3);
    if (cell(row, "outcome") != "success") continue;
    ++successes;
    last_s += std::stod(cell(row, "last_arrival_s"));
  }
  EXPECT_EQ(results.rows().size(), 12u);
  EXPECT_GE(successes, 11) << campaign_table(results.rows());
  EXPECT_LT(last_s / successes, 9.8) << campaign_table(results.rows());
}

// Eight robots from room to room through doors and a hall where columns move.
TEST(CampaignSuccess, RobotsFlyFromRoomToRoom) {
  TemporaryDirectory directory;
  std::vector<Trial> trials;
  for (const int seed : {501, 502, 503, 504}) trials.push_back(seeded_trial("hall", "pure", 15, seed));
  ResultsFile results(directory / "results.csv");
  ASSERT_TRUE(fly_campaign(
      trials, {}, 2, results, [] { return true; }, [](const TrialRow&) {}));
  ASSERT_EQ(results.rows().size(), 4u);
  for (const TrialRow& row : results.rows())
    EXPECT_EQ(cell(row, "outcome"), "success") << cell(row, "trial") << ": " << cell(row, "touches");
}

// A thousand rods and balls of 1 mm to 5 cm in the way of two robots, half of them moving, many at voxels' corners.
TEST(CampaignSuccess, NothingThinIsFlownThrough) {
  std::mt19937 engine(20);
  const auto draw = [&engine](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine);
  };
  std::vector<Trial> trials;
  for (int k = 0; k < 25; ++k) {
    World world;
    world.name = "thin-" + std::to_string(k);
    world.obstacle_bounds = {{-7, -7}, {7, 7}};
    world.robots = {{0, {-7.5, 0, 1}, {{{7.5, 0, 1}}}}, {1, {7.5, 0.5, 1.5}, {{{-7.5, 0.5, 1.2}}}}};
    for (int i = 0; i < 40; ++i) {
      WorldObstacle thin;
      thin.center = {draw(-6, 6), draw(-1.5, 1.5), draw(0.3, 2.2)};
      if (i % 4 < 2) thin.center = (10 * thin.center).array().round() / 10;
      if (i % 2 == 1) thin.velocity_mps = {draw(-0.5, 0.5), draw(-0.5, 0.5)};
      const double thickness_m = draw(0.001, 0.05), length_m = draw(0.05, 2);
      switch (i % 3) {
        case 0:
          thin.shape = {.kind = Shape::Kind::kColumn, .size = {thickness_m, length_m, 0}};
          break;
        case 1:
          thin.shape = {
              .kind = Shape::Kind::kBox, .size = {length_m, thickness_m, thickness_m}, .yaw_rad = draw(-3, 3)};
          break;
        default:
          thin.shape = {.kind = Shape::Kind::kSphere, .size = {thickness_m, 0, 0}};
          break;
      }
      world.obstacles.push_back(thin);
    }
    trials.push_back(listed_trial(to_json_text(world, ""), "thin:" + std::to_string(k)));
  }
  TemporaryDirectory directory;
  ResultsFile results(directory / "results.csv");
  ASSERT_TRUE(fly_campaign(
      trials, {}, 2, results, [] { return true; }, [](const TrialRow&) {}));
  ASSERT_EQ(results.rows().size(), 25u);
  for (const TrialRow& row : results.rows())
    EXPECT_EQ(cell(row, "outcome"), "success") << cell(row, "trial") << ": " << cell(row, "touches");
}

}  // namespace
}  // namespace swarm::test
