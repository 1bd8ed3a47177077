// What a broadcaster knows of a peer besides what the protocol knows: how well, when and by which clock it is heard.
#pragma once

#include <algorithm>
#include <cstdint>

#include "lcmtypes/bus/cell_messages.h"
#include "lcmtypes/bus/codec.h"
#include "planner_daemon/coordination/clock_offset.h"

namespace swarm {

// Of somebody only the newest counts, and waits until it may be looked at.
class Turn {
 public:
  void wait() { waits_ = true; }
  bool waits() const { return waits_; }
  // At `now` + `longest` the latest: the clock may have been set back. kNever: nothing waits.
  Utime due(Utime now, Duration longest) {
    may_go_ = std::min(may_go_, now + longest);
    return waits_ ? std::max(may_go_, now) : kNever;
  }
  // The next one no earlier than after `gap`, or by as much earlier, up to `saved`, as this one could have gone before.
  void taken(Utime now, Duration gap, Duration saved = {}) {
    waits_ = false;
    may_go_ = std::clamp(may_go_, now - saved, now) + gap;
  }
  void set_clock(Duration step) { may_go_ += step; }

 private:
  bool waits_ = false;
  Utime may_go_{};
};

struct PeerLink {
  SequenceGate gate;
  ClockOffset clock;
  Utime heard{};                  // of the newest announcement
  std::int32_t answered_seq = 0;  // the newest of ours that it judged
  Duration in_vain{};             // so long it was waited for since then, or its clock was wrong
  std::int32_t boot = -1, lost = 0;
  std::int64_t seq = 0;

  CellAnnouncement newest;                // of who flies by a roster what the robot says alone
  sogm_swarm::announcement_t last_words;  // that the protocol knows
  Turn turn;                              // of the newest, to be judged

  bool is_of_other_time = false;  // what waits: where the peer is, with times set to ours, is for the planner alone
  SequenceGate other_time;
};

}  // namespace swarm
