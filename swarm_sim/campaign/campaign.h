// Many flights in lock-step on all cores, a CSV row each as it ends.
//
// The room campaign/ stands on all others: options on the command line, trials, their rows and tables.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "swarm_sim/campaign/trial.h"

namespace swarm {

// The results of a campaign on disk. A row is appended whole, so that a campaign that was stopped goes on where it was.
class ResultsFile {
 public:
  // Opens for appending, or makes the file with its header. While another one has it open, also in another process or
  // on another computer of a shared folder, calls `waits` once, with how many rows there are, and waits. A torn last
  // line is dropped. Throws std::runtime_error with path and reason where the file cannot be written or locked, and
  // with path, line and reason on anything that is no result of this program version.
  explicit ResultsFile(
      std::filesystem::path path, const std::function<void(std::size_t)>& waits = [](std::size_t) {});
  ~ResultsFile();
  ResultsFile(const ResultsFile&) = delete;
  ResultsFile& operator=(const ResultsFile&) = delete;

  const std::vector<TrialRow>& rows() const { return rows_; }
  bool holds(const std::string& trial) const;
  void append(const TrialRow& row);

 private:
  std::filesystem::path path_;
  int descriptor_ = -1;
  std::vector<TrialRow> rows_;
};

// Rows of a results file. Throws as ResultsFile does; a torn last line is an error here.
std::vector<TrialRow> read_results(const std::filesystem::path& path);

// All rows of several files in the order of the trials' names, each trial once. Throws std::runtime_error when two
// files disagree about what came of a trial, and when there are not as many trials as `expected`, naming the files that
// hold fewer than an equal share of them.
std::vector<TrialRow> merge_results(const std::vector<std::filesystem::path>& paths,
                                    std::optional<std::size_t> expected = std::nullopt);

// Flies the trials that `results` does not hold with `jobs` threads. `ended` is called after every row, by one thread
// at a time. When `keep_on` says false, flights under way are dropped and it returns false. Throws what a flight
// throws.
bool fly_campaign(const std::vector<Trial>& trials, const FlightArguments& arguments, int jobs, ResultsFile& results,
                  const std::function<bool()>& keep_on, const std::function<void(const TrialRow&)>& ended);

// Success, collisions, deadlocks and flight times by task, environment and number of obstacles, as a table.
std::string campaign_table(const std::vector<TrialRow>& rows);

}  // namespace swarm
