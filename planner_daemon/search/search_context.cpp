#include "planner_daemon/search/search_context.h"

#include <algorithm>

namespace swarm {
namespace {

// What lies ahead counts less and less, for it can still be replanned: down to a least share after this long.
constexpr double kFade_s = 1.0, kLeastFade = 0.05;

}  // namespace

const char* to_string(SearchStatus status) {
  switch (status) {
    case SearchStatus::kGoal:
      return "goal";
    case SearchStatus::kSurvives:
      return "survives";
    case SearchStatus::kPartial:
      return "partial";
  }
  return "?";
}

SearchContext::SearchContext(const SearchLimits& limits_in, const SearchOptions& options_in, BlockedSpace rule_in)
    : limits(limits_in),
      options(options_in),
      rule(rule_in),
      primitives(limits_in, options_in),
      first_words(static_cast<std::size_t>(options_in.num_pieces)),
      heuristic_steps(static_cast<std::size_t>(options_in.num_pieces)) {}

void SearchContext::set(const SearchProblem& problem_in) {
  problem = problem_in;
  const Sogm& map = problem.space->grid();
  space = Eigen::AlignedBox3d(limits.space_min, limits.space_max).intersection(problem.space->known());
  v_max_mps = std::min(limits.v_max_mps, problem.v_max_mps);
  primitives.lay_out(map.geometry, space, v_max_mps);
  heuristic.set(problem, v_max_mps, primitives.a_usable_mps2());
  hover_until_utime = std::max(utime_at(options.num_pieces), map.end_utime());
  start_blocked = problem.space->blocked_at(problem.start.position, map.frame_at(problem.start_utime));
  words_per_frame = map.geometry.words_per_frame();
  for (int depth = 0; depth < options.num_pieces; ++depth) {
    for (int i = 0; i < primitives.num_samples(); ++i) {
      first_words[static_cast<std::size_t>(depth)][static_cast<std::size_t>(i)] =
          map.frame_at(utime_of_sample(depth, i)) * words_per_frame;
    }
    heuristic_steps[static_cast<std::size_t>(depth)] = heuristic.step_at(utime_at(depth + 1));
  }
}

double SearchContext::blocked_cost(double ahead_s, Severity severity) const {
  const double fade = std::max(kLeastFade, 1.0 - ahead_s / kFade_s);
  const double factor = severity == Severity::kCollision ? 100.0 : severity == Severity::kEmergency ? 10.0 : 1.0;
  return options.leave_weight * fade * factor;
}

}  // namespace swarm
