// One flight of a campaign, and its row in the results: what flew, what came of it, the command that repeats it.
#pragma once

#include <string>
#include <vector>

#include "swarm_sim/campaign/flight_arguments.h"
#include "swarm_sim/results/report.h"
#include "swarm_sim/world/world_generator.h"

namespace swarm {

// Either drawn from a seed or a line of a list of worlds (world_list.h).
struct Trial {
  std::string name;  // unique in a campaign: cross-mixed-20-7, or FILE.jsonl.gz:12
  std::string task, environment;
  int obstacles = 0;
  std::string seed;                 // as text; empty for a world that does not say
  Fleet fleet;                      // of a seeded world
  std::string world_text, list_at;  // of a list: the JSON, and FILE:N

  World world() const;
  // One shell line that flies this trial again with trace, report and LCM logs.
  std::string command(const FlightArguments& arguments) const;
};

Trial seeded_trial(const std::string& task, const std::string& environment, int obstacles, int seed,
                   const Fleet& fleet = {});
// Task, environment, obstacles and seed are read off a name like cross-mixed-20-7; any other name is its own task.
Trial listed_trial(const std::string& text, const std::string& list_at);

// A row of the results: the columns of trial_columns().
using TrialRow = std::vector<std::string>;
const std::vector<std::string>& trial_columns();
TrialRow trial_row(const Trial& trial, const World& world, const RunReport& report, const std::string& command);

// The cell of a column of trial_columns(); std::out_of_range for any other name.
const std::string& cell(const TrialRow& row, const std::string& column);

}  // namespace swarm
