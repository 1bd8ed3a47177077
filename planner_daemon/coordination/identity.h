// Which start of which robot a node is, and whether it alone speaks as that robot: a copied memory card, a wrong id or
// a second set of daemons is a twin.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/time.h"
#include "sogm_swarm/header_t.hpp"

namespace swarm {

class Identity {
 public:
  // `num_peers`: so many may know a later start.
  Identity(int robot_id, std::int32_t boot, int num_peers) : robot_id_(robot_id), boot_(boot), num_peers_(num_peers) {}

  std::int32_t boot() const { return boot_; }  // grows at every start
  // Before anything else of a step. No time is held to that the clock, set back since, has not come to.
  void advance(Utime now);
  // It is `now` by another clock, which is ahead of the one before by `step`. What was said before is not another
  // one's.
  void set_clock(Utime now, Duration step);
  // Of an announcement of this node, on one of its buses.
  void said(BusId bus, const sogm_swarm::header_t& header);

  // Whether an announcement under this robot's id is neither this node's nor an earlier start's. Then there is a twin
  // until 2 s after the last one.
  bool is_of_twin(Utime now, BusId bus, const sogm_swarm::header_t& header);
  bool has_twin(Utime now) const { return now < twin_until_; }
  // The twin was heard on the robot's own bus, where setpoints of two would alternate: who started later leaves the
  // robot to the other.
  void give_way(Utime now, std::int32_t its_boot);
  bool gives_way(Utime now) const { return now < silent_until_; }
  // A peer knows a later start of this robot than this one, and would refuse this one as an old one: what was promised
  // had got lost with the disk, or the clock was set back. True: this one is the later one now. But who has flown was
  // heard: then it is another one's. Each peer knows one start.
  [[nodiscard]] bool outdo(Utime now, std::int32_t its_boot, bool has_flown);
  // Peers have given this start up: from here on it is the next one. Not again within a second, whoever says so.
  [[nodiscard]] bool start_anew(Utime now);

 private:
  void beware_of_twin(Utime now, std::int32_t its_boot);

  int robot_id_;
  std::int32_t boot_;
  int num_peers_, num_outdone_ = 0;
  std::optional<Utime> began_;  // this node, by its clock
  // header.utime of the newest announcements of each bus, by header.seq [us].
  std::array<std::array<std::int64_t, 1024>, 2> said_{};
  Utime twin_until_{}, silent_until_{}, given_up_{};
};

}  // namespace swarm
