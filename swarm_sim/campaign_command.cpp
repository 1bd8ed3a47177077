#include "swarm_sim/campaign_command.h"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <iostream>
#include <optional>
#include <set>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/text.h"
#include "swarm_sim/campaign/campaign.h"
#include "swarm_sim/campaign/usable_cores.h"
#include "swarm_sim/results/csv.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_list.h"

namespace swarm {
namespace {

struct CampaignOptions {
  std::string tasks = "cross,bilateral,unilateral", environments = "pure,mixed", worlds, out, shard = "1/1";
  std::vector<int> obstacles = {10, 20, 30, 40, 50};
  int trials = 50, first_seed = 1, jobs = 0;
  Fleet fleet;
  FlightArguments flight;
};

void declare(OptionSet& set, CampaignOptions& options) {
  set.add("tasks", &options.tasks, "comma-separated: cross, bilateral, unilateral, circle, random, hall, tour");
  set.add("envs", &options.environments, "comma-separated: empty, pure (columns), mixed (columns and rings)");
  set.add("obstacles", &options.obstacles, 0, 500, "numbers of obstacles");
  set.add("trials", &options.trials, 1, 1'000'000, "", "seeds per task, environment and number of obstacles");
  set.add("first-seed", &options.first_seed, 0, 1'000'000'000, "", "seeds are this and the following");
  set.add("worlds", &options.worlds,
          "flies these worlds instead: JSON lines, FILE.jsonl or FILE.jsonl.gz, or a directory of world files");
  set.add("shard", &options.shard, "i/n: only every n-th trial, from the i-th on (1 <= i <= n)");
  set.add("jobs", &options.jobs, 0, 1024, "",
          "flights at a time; 0: as many as it may use cores, also by Slurm's count");
  set.add("out", &options.out, "results (CSV); trials it already holds are skipped");
  declare(set, options.fleet);
  declare(set, options.flight);
}

std::vector<Trial> all_trials(const CampaignOptions& options) {
  std::vector<Trial> trials;
  if (!options.worlds.empty()) {
    std::error_code ignored;
    if (!options.worlds.ends_with(".jsonl") && !options.worlds.ends_with(".jsonl.gz") &&
        !std::filesystem::is_directory(options.worlds, ignored))
      throw OptionError("worlds: '" + options.worlds + "' must end in .jsonl or .jsonl.gz, or be a directory");
    for (const ListedWorld& listed : read_listed_worlds(options.worlds))
      trials.push_back(listed_trial(listed.text, listed.place));
    return trials;
  }
  std::set<std::string> names;
  for (const std::string& task : split(options.tasks, ',')) {
    (void)task_from(task);
    for (const std::string& environment : split(options.environments, ',')) {
      const bool empty = environment_from(environment) == Environment::kEmpty;
      for (const int obstacles : empty ? std::vector<int>{0} : options.obstacles) {
        for (int i = 0; i < options.trials; ++i) {
          Trial trial = seeded_trial(task, environment, obstacles, options.first_seed + i, options.fleet);
          if (names.insert(trial.name).second) trials.push_back(std::move(trial));
        }
      }
    }
  }
  if (trials.empty()) throw OptionError("tasks, envs, obstacles: must name at least one each");
  return trials;
}

std::vector<Trial> shard_of(std::vector<Trial> trials, const std::string& shard) {
  int i = 0, n = 0, used = 0;
  if (std::sscanf(shard.c_str(), "%9d/%9d%n", &i, &n, &used) != 2 || used != static_cast<int>(shard.size()) || i < 1 ||
      i > n)
    throw OptionError("shard: '" + shard + "' must be i/n with 1 <= i <= n");
  std::vector<Trial> mine;
  for (std::size_t k = static_cast<std::size_t>(i) - 1; k < trials.size(); k += static_cast<std::size_t>(n))
    mine.push_back(std::move(trials[k]));
  return mine;
}

// Resuming with other options would mix what cannot be compared.
void check_same_options(const std::vector<Trial>& trials, const FlightArguments& arguments,
                        const ResultsFile& results) {
  for (const TrialRow& row : results.rows()) {
    const auto trial = std::ranges::find(trials, cell(row, "trial"), &Trial::name);
    if (trial != trials.end() && trial->command(arguments) != cell(row, "command"))
      throw OptionError("out: trial " + trial->name + " was flown with other options: " + cell(row, "command"));
  }
}

std::string duration_text(double seconds) {
  if (seconds < 90) return std::to_string(static_cast<int>(seconds)) + " s";
  if (seconds < 5400) return std::to_string(static_cast<int>(seconds / 60)) + " min";
  return std::to_string(static_cast<int>(seconds / 3600)) + " h " +
         std::to_string(static_cast<int>(seconds / 60) % 60) + " min";
}

// Rate and time left; renews its line on a terminal, speaks every half minute elsewhere. Failures get their own line.
class Progress {
 public:
  Progress(std::size_t done_before, std::size_t total) : done_before_(done_before), done_(done_before), total_(total) {}

  void ended(const TrialRow& row) {
    ++done_;
    if (cell(row, "outcome") == "success") {
      ++successes_;
    } else {
      std::fprintf(stderr, "%s%s: %s%s%s\n", terminal_ ? "\r\033[K" : "", cell(row, "trial").c_str(),
                   cell(row, "outcome").c_str(), cell(row, "touches").empty() ? "" : ": ",
                   cell(row, "touches").c_str());
    }
    const double now_s = seconds();
    if (!terminal_ && now_s < next_s_ && done_ < total_) return;
    next_s_ = now_s + 30.0;
    const auto flown = static_cast<double>(done_ - done_before_);
    constexpr std::size_t kWidth = 24;
    const std::size_t filled = done_ * kWidth / total_;
    const std::string bar = std::string(filled, '#') + std::string(kWidth - filled, '.');
    std::fprintf(stderr, "%s[%s] %zu/%zu  success %.1f %%  %.2f trials/s  %s left%s", terminal_ ? "\r\033[K" : "",
                 bar.c_str(), done_, total_, 100.0 * successes_ / flown, flown / now_s,
                 duration_text(static_cast<double>(total_ - done_) / flown * now_s).c_str(),
                 terminal_ && done_ < total_ ? "" : "\n");
  }

 private:
  double seconds() const { return std::chrono::duration<double>(stopwatch() - began_).count(); }

  bool terminal_ = ::isatty(STDERR_FILENO) != 0;
  std::size_t done_before_, done_, total_;
  int successes_ = 0;
  double next_s_ = 0.0;
  std::chrono::nanoseconds began_ = stopwatch();
};

std::atomic<bool> interrupted = false;  // set by a signal, read by all workers
static_assert(std::atomic<bool>::is_always_lock_free);

}  // namespace

int campaign_command(int argc, const char* const* argv) try {
  CampaignOptions options;
  OptionSet set("swarm_sim campaign", "Flies many seeded worlds in lock-step, one CSV row a trial as it ends.");
  declare(set, options);
  if (set.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  if (options.out.empty()) throw OptionError("out: a file for the results must be given");
  (void)flight_options(options.flight);
  const std::vector<Trial> trials = shard_of(all_trials(options), options.shard);
  const int jobs = options.jobs > 0 ? options.jobs : usable_cores();
  ResultsFile results(options.out, [&](std::size_t rows) {
    std::cerr << "campaign: another campaign is writing " << options.out << " (rows so far: " << rows
              << "); waiting until it ends\n";
  });
  check_same_options(trials, options.flight, results);
  const auto done = static_cast<std::size_t>(
      std::ranges::count_if(trials, [&](const Trial& trial) { return results.holds(trial.name); }));
  std::cerr << "campaign: " << trials.size() << " trials, " << done << " of them already in " << options.out << ", "
            << jobs << " at a time\n";
  spdlog::set_level(spdlog::level::err);  // what single robots tell is told by their flights' rows
  std::signal(SIGINT, [](int) { interrupted = true; });
  std::signal(SIGTERM, [](int) { interrupted = true; });
  Progress progress(done, trials.size());
  const bool whole = fly_campaign(
      trials, options.flight, jobs, results, [] { return !interrupted; },
      [&](const TrialRow& row) { progress.ended(row); });
  if (!whole) {
    std::cerr << "\nswarm_sim campaign: interrupted; the same command goes on where it was\n";
    return 130;
  }
  std::vector<TrialRow> mine;
  for (const TrialRow& row : results.rows()) {
    if (std::ranges::find(trials, cell(row, "trial"), &Trial::name) != trials.end()) mine.push_back(row);
  }
  std::cout << campaign_table(mine) << std::flush;
  return 0;
} catch (const std::exception& error) {
  std::cerr << "swarm_sim campaign: " << error.what() << '\n';
  return 2;
}

int merge_command(int argc, const char* const* argv) try {
  constexpr const char* kUsage =
      "Usage: swarm_sim merge RESULTS... -o FILE [--expect N]\n"
      "Joins the results of a campaign's shards, in the order of the trials, each once; prints the table.\n"
      "  --expect N  joins nothing unless there are N trials in all; says which files hold fewer than their share\n";
  std::vector<std::filesystem::path> paths;
  std::string out;
  std::optional<std::size_t> expected;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--help" || argument == "-h") {
      std::cout << kUsage;
      return 0;
    }
    if (argument == "--version") {
      std::cout << version_line("swarm_sim") << '\n';
      return 0;
    }
    if (argument == "-o" || argument == "--out") {
      if (++i == argc) throw OptionError(argument + ": needs a file");
      out = argv[i];
    } else if (argument == "--expect") {
      const std::string number = ++i < argc ? argv[i] : "";
      int trials = 0;
      if (!read_amount(number, &trials) || trials < 1)
        throw OptionError("expect: '" + number + "' must be a number of trials from 1 on");
      expected = static_cast<std::size_t>(trials);
    } else if (argument.size() > 1 && argument[0] == '-') {
      throw OptionError("unknown option '" + argument + "' (see --help)");
    } else {
      paths.emplace_back(argument);
    }
  }
  if (paths.empty() || out.empty()) throw OptionError("RESULTS and -o FILE must be given (see --help)");
  const std::vector<TrialRow> rows = merge_results(paths, expected);
  std::string text = csv_line(trial_columns()) + "\n";
  for (const TrialRow& row : rows) text += csv_line(row) + "\n";
  write_file(out, text);
  std::cout << campaign_table(rows) << std::flush;
  return 0;
} catch (const std::exception& error) {
  std::cerr << "swarm_sim merge: " << error.what() << '\n';
  return 2;
}

}  // namespace swarm
