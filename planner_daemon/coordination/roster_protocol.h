// The commit protocol among the robots of one roster, as the broadcaster asks for it.
#pragma once

#include <vector>

#include "planner_daemon/coordination/flight_agreement.h"

namespace swarm {

class RosterProtocol : public FlightAgreement {
 public:
  explicit RosterProtocol(const CommitProtocol::Rules& rules);

  void start(const Motion& motion, std::int32_t forced_seq, const Standings&) override {
    protocol_.start(motion, forced_seq);
  }
  Rejection propose(Utime now, const Trajectory& candidate, const Keep&, bool urgent) override {
    return protocol_.propose(now, candidate, urgent);
  }
  void receive(Utime now, const CellAnnouncement& message, const Keep& keep) override {
    protocol_.receive(now, message.robot, alone(keep));
  }
  void advance(Utime now, const Keep&) override { protocol_.advance(now); }
  void set_clock(Utime now, Duration step) override { protocol_.set_clock(now, step); }
  bool commit(const Keep& keep) override { return protocol_.commit(alone(keep)); }
  CommitProtocol::News take_news() override { return protocol_.take_news(); }
  bool is_awaited(Utime now) const override { return protocol_.is_awaited(now); }
  Utime due_utime(Utime now) const override { return protocol_.due_utime(now); }
  CellAnnouncement state() const override { return {protocol_.state(), {}, {}}; }
  CellAnnouncement promise() const override { return {protocol_.promise(), {}, {}}; }
  int told_about(const CellAnnouncement& message) const override;
  // Who is given up stays a peer, and strangers never were.
  std::vector<sogm_swarm::announcement_t> tombstones() const override { return {}; }
  const CommitProtocol& robot() const override { return protocol_; }
  CommitProtocol& robot() override { return protocol_; }

  // What keeps an announcement that is in no cells. It holds on to `keep`.
  static CommitProtocol::Keep alone(const Keep& keep);

 private:
  CommitProtocol protocol_;
  std::vector<int> places_;  // ids of all robots of the roster, ascending
};

}  // namespace swarm
