// How a robot agrees with others on what it flies, whoever these are: those of its roster (roster_protocol.h), or who
// is in the same cells (cell_protocol.h). In both the rules among those who ask each other are those of
// commit_protocol.h, and robot() is where they are kept.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "lcmtypes/bus/cell_messages.h"
#include "planner_daemon/coordination/commit_protocol.h"

namespace swarm {

class FlightAgreement {
 public:
  // Whether it is kept and will survive a crash.
  using Keep = std::function<bool(const CellAnnouncement& promise)>;
  using Standings = std::map<Cell, CellAnnouncement::Standing>;

  virtual ~FlightAgreement() = default;

  // As in CommitProtocol; `kept`: the cells that an earlier start had to do with.
  virtual void start(const Motion& motion, std::int32_t forced_seq, const Standings& kept) = 0;
  virtual Rejection propose(Utime now, const Trajectory& candidate, const Keep& keep, bool urgent) = 0;
  // Of a peer; of others it changes nothing.
  virtual void receive(Utime now, const CellAnnouncement& message, const Keep& keep) = 0;
  virtual void advance(Utime now, const Keep& keep) = 0;
  virtual void set_clock(Utime now, Duration step) = 0;
  virtual bool commit(const Keep& keep) = 0;

  virtual CommitProtocol::News take_news() = 0;
  virtual bool is_awaited(Utime now) const = 0;
  virtual Utime due_utime(Utime now) const = 0;

  // All but the header and what is known of clocks: to be said, and to survive a crash.
  virtual CellAnnouncement state() const = 0;
  virtual CellAnnouncement promise() const = 0;
  // The robot whose messages' delay an announcement tells, each in turn; -1: of none.
  virtual int told_about(const CellAnnouncement& message) const = 0;

  // What robots may fly that were peers, and are kept off without being asked: by their newest announcements.
  virtual std::vector<sogm_swarm::announcement_t> tombstones() const = 0;

  // Its motions and its peers.
  virtual const CommitProtocol& robot() const = 0;
  // For what it has to be told of itself: errors and clocks that are doubted, what is forced, what was said.
  virtual CommitProtocol& robot() = 0;
};

}  // namespace swarm
