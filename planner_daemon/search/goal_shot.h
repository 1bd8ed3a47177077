// How a path of the search ends at the goal: in one quintic.
#pragma once

#include <optional>

#include "planner_daemon/search/search_context.h"
#include "planner_daemon/search/search_tree.h"

namespace swarm {

class GoalShot {
 public:
  // `context` must outlive it.
  explicit GoalShot(const SearchContext& context) : context_(context) {}
  // For another problem of the context.
  void reset() { goal_open_utime_.reset(); }

  // Quintic from a node to rest at the goal in as few pieces as the limits allow, then hovering there, all free and
  // where nothing was recently; inside the flight space. The knots behind the node's go to `path`. False when there is
  // none.
  [[nodiscard]] bool shoot(const SearchNode& node, SearchPath* path);

 private:
  // From when on hovering at the goal is so until the horizon; kNever: not at all.
  Utime goal_open_from() const;
  bool is_free(const SearchNode& node, const SearchPath& path, int pieces) const;

  const SearchContext& context_;
  std::optional<Utime> goal_open_utime_;  // once it was asked for
};

}  // namespace swarm
