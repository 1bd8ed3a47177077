// Listens to the buses of one robot whose daemons are processes: what passes goes to the recorder; what the daemons say
// about themselves tells whether they are ready, and what they have done in the end.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "lcmtypes/bus/node.h"
#include "swarm_sim/results/bus_recorder.h"
#include "swarm_sim/results/report.h"

namespace swarm {

// Which messages on the swarm bus a robot's watch records. Of robots on a bus in common one does so for all.
enum class SwarmShare { kNone, kOwn, kAll };

class RobotWatch : public Node {
 public:
  // `recorder` must outlive it. `cells`: channels on the swarm bus in a flight in cells.
  RobotWatch(int robot_id, SwarmShare share, BusRecorder& recorder, const std::set<std::string>& cells = {});

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;

  // What keeps the robot from flying, in words; empty: nothing.
  std::string missing() const;
  // Now the flight begins: whatever the daemons counted before is not the flight's.
  void mark_start();

  // Counts of the flight so far; the verdict is for others to fill in. What was refused is what the daemons that live
  // have counted since they began.
  RobotReport counts() const;
  const PlanningSamples& step_ms() const { return step_ms_; }
  std::int32_t lost() const { return broadcast_.lost; }  // announcements of peers

 private:
  bool is_own(std::string_view channel, std::span<const std::uint8_t> bytes) const;  // of the swarm bus
  void note_plan(std::span<const std::uint8_t> bytes);

  int id_;
  SwarmShare share_;
  BusRecorder& recorder_;
  std::set<std::string> cells_;
  bool started_ = false;
  sogm_swarm::map_status_t map_{};  // newest; all zero: none yet
  sogm_swarm::planner_status_t planner_{};
  sogm_swarm::broadcast_status_t broadcast_{};
  std::int32_t plans_seen_ = 0, plans_before_ = 0, missed_before_ = 0;
  PlanningSamples step_ms_;
};

}  // namespace swarm
