#include "swarm_sim/campaign/campaign.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <thread>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/lock_file.h"
#include "lcmtypes/bus/temporary_directory.h"
#include "lcmtypes/bus/text.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/results/csv.h"
#include "swarm_sim/world/walls.h"

namespace swarm {
namespace {

std::string read_text(const std::filesystem::path& path) {
  std::error_code ignored;
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path, ignored))
    throw std::runtime_error(path.string() + ": must be a readable results file");
  return {std::istreambuf_iterator<char>(in), {}};
}

// Rows of whole lines; `torn`: how many bytes of an unfinished last line were left out.
std::vector<TrialRow> parse_rows(const std::string& text, const std::filesystem::path& path, std::size_t* torn) {
  std::vector<TrialRow> rows;
  std::size_t begin = 0;
  for (int number = 1;; ++number) {
    const std::size_t end = text.find('\n', begin);
    if (end == std::string::npos) break;
    const std::string where = path.string() + ": line " + std::to_string(number) + ": ";
    TrialRow row;
    try {
      row = csv_cells(std::string_view(text).substr(begin, end - begin));
    } catch (const std::invalid_argument& error) {
      throw std::runtime_error(where + error.what());
    }
    if (number == 1 && row != trial_columns())
      throw std::runtime_error(where + "must be the columns of this program's results");
    if (row.size() != trial_columns().size())
      throw std::runtime_error(where + std::to_string(row.size()) + " cells; must be " +
                               std::to_string(trial_columns().size()));
    if (number > 1) rows.push_back(std::move(row));
    begin = end + 1;
  }
  *torn = text.size() - begin;
  return rows;
}

// All at once, as far as there is room.
void append_text(int descriptor, std::string_view text, const std::filesystem::path& path) {
  while (!text.empty()) {
    const ssize_t written = ::write(descriptor, text.data(), text.size());
    if (written < 0) fail_to_write(path);
    text.remove_prefix(static_cast<std::size_t>(written));
  }
}

// cross-mixed-9-3 before cross-mixed-10-1: runs of digits compare as numbers.
bool natural_less(const std::string& a, const std::string& b) {
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (digit(a[i]) && digit(b[j])) {
      std::size_t m = i, n = j;
      while (m < a.size() && digit(a[m])) ++m;
      while (n < b.size() && digit(b[n])) ++n;
      if (m - i != n - j) return m - i < n - j;  // no leading zeros in our names
      const int order = a.compare(i, m - i, b, j, n - j);
      if (order != 0) return order < 0;
      i = m, j = n;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i, ++j;
    }
  }
  return a.size() - i < b.size() - j;
}

std::optional<OccupiedCubes> static_map_of(const World& world) {
  if (world.static_map.empty()) return std::nullopt;
  OccupiedCubes cubes = OccupiedCubes::load(world.static_map);
  check_starts(world, cubes);
  return cubes;
}

std::string percent(int part, int whole) {
  std::string text;
  append_fixed(whole == 0 ? 0.0 : 100.0 * part / whole, 1, &text);
  return text;
}

}  // namespace

ResultsFile::ResultsFile(std::filesystem::path path, const std::function<void(std::size_t)>& waits)
    : path_(std::move(path)) {
  descriptor_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (descriptor_ < 0) fail_to_write(path_);
  try {
    std::size_t torn = 0;
    lock_open_file(descriptor_, path_, [&] { waits(parse_rows(read_text(path_), path_, &torn).size()); });
    const std::string text = read_text(path_);
    rows_ = parse_rows(text, path_, &torn);
    if (torn == text.size() && torn > 0 && csv_line(trial_columns()).compare(0, torn, text) != 0)
      throw std::runtime_error(path_.string() + ": line 1: must be the columns of this program's results");
    if (torn > 0 && ::ftruncate(descriptor_, static_cast<off_t>(text.size() - torn)) != 0) fail_to_write(path_);
    if (torn == text.size()) append_text(descriptor_, csv_line(trial_columns()) + "\n", path_);
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

ResultsFile::~ResultsFile() {
  ::close(descriptor_);
}

bool ResultsFile::holds(const std::string& trial) const {
  return std::ranges::any_of(rows_, [&](const TrialRow& row) { return cell(row, "trial") == trial; });
}

void ResultsFile::append(const TrialRow& row) {
  append_text(descriptor_, csv_line(row) + "\n", path_);
  rows_.push_back(row);
}

std::vector<TrialRow> read_results(const std::filesystem::path& path) {
  std::size_t torn = 0;
  std::vector<TrialRow> rows = parse_rows(read_text(path), path, &torn);
  if (torn > 0) throw std::runtime_error(path.string() + ": last line: must end (is a campaign still writing it?)");
  return rows;
}

std::vector<TrialRow> merge_results(const std::vector<std::filesystem::path>& paths,
                                    std::optional<std::size_t> expected) {
  const std::size_t share = expected.value_or(0) / std::max<std::size_t>(paths.size(), 1);
  std::string too_few;
  std::map<std::string, TrialRow, decltype(&natural_less)> rows(&natural_less);
  for (const std::filesystem::path& path : paths) {
    const std::vector<TrialRow> part = read_results(path);
    if (part.size() < share) {
      too_few += too_few.empty() ? "; fewer than " + std::to_string(share) + " of them are in " : ", ";
      too_few += path.string() + " (" + std::to_string(part.size()) + ")";
    }
    for (const TrialRow& row : part) {
      const std::string name = cell(row, "trial");
      const auto [known, is_new] = rows.try_emplace(name, row);
      if (is_new) continue;
      for (const char* column : {"outcome", "touches", "last_arrival_s", "command"}) {
        if (cell(known->second, column) != cell(row, column)) {
          throw std::runtime_error(path.string() + ": " + name + ": " + column + " '" + cell(row, column) +
                                   "' must be '" + cell(known->second, column) + "' as in another file");
        }
      }
    }
  }
  if (expected && rows.size() != *expected) {
    throw std::runtime_error("expect: " + std::to_string(rows.size()) + " trials are there; must be " +
                             std::to_string(*expected) + too_few);
  }
  std::vector<TrialRow> merged;
  merged.reserve(rows.size());
  for (auto& [name, row] : rows) merged.push_back(std::move(row));
  return merged;
}

bool fly_campaign(const std::vector<Trial>& trials, const FlightArguments& arguments, int jobs, ResultsFile& results,
                  const std::function<bool()>& keep_on, const std::function<void(const TrialRow&)>& ended) {
  const FlightOptions options = flight_options(arguments);
  std::vector<const Trial*> open;
  for (const Trial& trial : trials) {
    if (!results.holds(trial.name)) open.push_back(&trial);
  }
  std::mutex mutex;  // of all that follows
  std::size_t next = 0;
  bool going = true;
  std::exception_ptr failure;
  const auto work = [&] {
    for (;;) {
      const Trial* trial = nullptr;
      {
        const std::lock_guard lock(mutex);
        going = going && keep_on();
        if (!going || next == open.size()) return;
        trial = open[next++];
      }
      try {
        const TemporaryDirectory scratch("swarm_sim");
        const World world = flown_world(with_walls_in_file(trial->world(), scratch.path()), arguments);
        const auto static_map = static_map_of(world);
        bool whole = true;
        const RunReport report =
            run_lockstep(world, static_map ? &*static_map : nullptr, options, LockstepDelays(), nullptr, nullptr,
                         [&](double, const Simulation&) { return whole = keep_on(); });
        const std::lock_guard lock(mutex);
        going = going && whole;
        if (!going) return;
        results.append(trial_row(*trial, world, report, trial->command(arguments)));
        ended(results.rows().back());
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (!failure) failure = std::current_exception();
        going = false;
        return;
      }
    }
  };
  std::vector<std::thread> workers;
  workers.reserve(static_cast<std::size_t>(jobs));
  for (int i = 0; i < jobs; ++i) workers.emplace_back(work);
  for (std::thread& worker : workers) worker.join();
  if (failure) std::rethrow_exception(failure);
  return going;
}

std::string campaign_table(const std::vector<TrialRow>& rows) {
  struct Statistic {
    int trials = 0, successes = 0, collisions = 0, hits_at_rest = 0, robot_touches = 0, conflicts = 0, forced = 0;
    double last_s = 0.0, mean_s = 0.0;
    void add(const TrialRow& row) {
      ++trials;
      const std::string& outcome = cell(row, "outcome");
      if (cell(row, "touches").find("-robot ") != std::string::npos) ++robot_touches;
      conflicts += std::stoi(cell(row, "commit_conflicts"));
      forced += std::stoi(cell(row, "forced_commits"));
      if (outcome == "collision") ++collisions;
      if (outcome == "collision" && cell(row, "paper_outcome") == "deadlock") ++hits_at_rest;
      if (outcome != "success") return;
      ++successes;
      last_s += std::stod(cell(row, "last_arrival_s"));
      mean_s += std::stod(cell(row, "mean_flight_s"));
    }
  };
  std::map<std::string, Statistic, decltype(&natural_less)> cells(&natural_less);
  Statistic all;
  for (const TrialRow& row : rows) {
    cells[cell(row, "task") + " " + cell(row, "env") + " " + cell(row, "obstacles")].add(row);
    all.add(row);
  }
  std::vector<std::vector<std::string>> lines = {{"", "trials", "success %", "collision %", "of them at rest",
                                                  "stuck %", "robot touches", "commit conflicts", "forced",
                                                  "last arrival s", "mean flight s"}};
  const auto line = [&](const std::string& name, const Statistic& c) {
    std::string last = "-", mean = "-";
    if (c.successes > 0) {
      last.clear(), mean.clear();
      append_fixed(c.last_s / c.successes, 2, &last);
      append_fixed(c.mean_s / c.successes, 2, &mean);
    }
    lines.push_back({name, std::to_string(c.trials), percent(c.successes, c.trials), percent(c.collisions, c.trials),
                     std::to_string(c.hits_at_rest), percent(c.trials - c.successes - c.collisions, c.trials),
                     std::to_string(c.robot_touches), std::to_string(c.conflicts), std::to_string(c.forced), last,
                     mean});
  };
  for (const auto& [name, c] : cells) line(name, c);
  line("all", all);
  return aligned(lines);
}

}  // namespace swarm
