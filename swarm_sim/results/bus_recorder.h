// Listens to what passes on the buses of a flight: the log, the counts, the audit.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <utility>

#include "swarm_sim/results/air_traffic.h"
#include "swarm_sim/results/commit_audit.h"
#include "swarm_sim/results/recorder.h"
#include "swarm_sim/results/report.h"

namespace swarm {

class BusRecorder {
 public:
  // `log` (may be null) must outlive it. `clocks_are_set`: robots' clocks, in flight; see CommitAudit::collect.
  // `clock_offset_ms`: as in FlightOptions. `world_time` [s] tells what is of the flight.
  BusRecorder(BusLog* log, bool clocks_are_set, double clock_offset_ms, std::function<double(Utime utime)> world_time)
      : log_(log), clocks_are_set_(clocks_are_set), world_time_(std::move(world_time)), audit_(clock_offset_ms) {}

  // One message, once for all who hear it. `robot_id`: of the sender.
  void hear(Utime now, BusId bus, int robot_id, std::string_view channel, std::span<const std::uint8_t> bytes);

  // So many datagrams of the swarm bus arrive at a robot; for hosts that know.
  void receive(int robot_id, std::size_t datagrams) { air_.receive(robot_id, datagrams); }

  // Adds counts and audit to the report.
  void finish(RunReport* report);

 private:
  BusLog* log_;
  bool clocks_are_set_;
  std::function<double(Utime)> world_time_;
  std::map<std::string, ChannelCount, std::less<>> channels_;
  CommitAudit audit_;
  AirTraffic air_;
};

}  // namespace swarm
