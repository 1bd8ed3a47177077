// Robots that were given another roster than this one. Nobody waits for them or answers them; but what they announce is
// drawn for the planner, and nothing that comes near it is committed.
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "lcmtypes/bus/codec.h"
#include "planner_daemon/coordination/peer_link.h"

namespace swarm {

class Strangers {
 public:
  // For receive(): its order, and that it is none too many (kRobot). They are kept for ever, as they may be anywhere.
  Refusal admit(const sogm_swarm::announcement_t& message);
  // What was admitted.
  void heard(sogm_swarm::announcement_t message);
  // It was given this roster since. False: it was no stranger.
  bool forget(int id) { return strangers_.erase(id) > 0; }
  // One that waits to be told to the robot itself: of each the newest, no more often than it has use for; none: nothing
  // is due.
  std::optional<sogm_swarm::announcement_t> take_due(Utime now);
  Utime due_utime(Utime now);  // kNever: nothing waits
  bool contains(int id) const { return strangers_.contains(id); }
  std::vector<int> ids() const;
  // The newest of each, for CommitProtocol::set_tombstones().
  std::vector<sogm_swarm::announcement_t> tombstones() const;
  // Of those the newest was told.
  std::vector<sogm_swarm::announcement_t> told() const;
  // The own clock is set: they move when they did.
  void set_clock(Duration step);

 private:
  struct Stranger {
    SequenceGate gate;
    sogm_swarm::announcement_t newest{};
    Turn turn;
  };
  std::map<int, Stranger> strangers_;
};

}  // namespace swarm
