// Plans before the first one that counts, so that it finds its memory and code in place: else it takes a hundred times
// as long as later ones.
#pragma once

#include "planner_daemon/planner.h"

namespace swarm {

// Flies from the middle of a window, hovers there, and gets stuck, in made-up worlds: sparse, dense, closed, empty and
// still ones, with peers.
class Rehearsal {
 public:
  explicit Rehearsal(const SearchLimits& limits) : limits_(limits) {}

  // One plan more, in a window like `map`'s. After the last one, when it returns false, nothing is left of them but
  // memory.
  bool plan(const Sogm& map, Planner* planner);

 private:
  SearchLimits limits_;
  int plans_ = 0;
};

}  // namespace swarm
