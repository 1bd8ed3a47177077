// What a run leaves behind while it runs: the trace of the true positions and an LCM log of every bus.
// All files appear under their names when close() succeeds; until then, and after a failure, they do not.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/node.h"
#include "swarm_sim/environment/simulation.h"

namespace swarm {

// What an earlier flight has left in a directory, but its world: of another mode or other robots, it would be taken for
// this one's.
void remove_results(const std::filesystem::path& directory);

// trace.csv: t,robot,x,y,z,vx,vy,vz,ax,ay,az, six digits after the point; s, id, m, m/s, m/s^2 in W.
class TraceWriter {
 public:
  // Throws std::runtime_error with path and reason, as all members here and below.
  explicit TraceWriter(const std::filesystem::path& path);
  void write(double t_s, int robot_id, const MotionState& state);
  void close();

 private:
  AtomicFile file_;
  std::ofstream out_;
  std::string line_;
};

// Where the robots of a flight are, in trace.csv, and where they were told to be, in commanded.csv, if that is not the
// same.
class FlightTrace {
 public:
  // `directory` must exist.
  FlightTrace(const std::filesystem::path& directory, bool is_followed_exactly);
  void write(double t_s, const Simulation& simulation);
  void close();

 private:
  TraceWriter flown_;
  std::optional<TraceWriter> commanded_;
};

// LCM event logs with the given times, one file a bus: swarm.lcm and robot<ID>.lcm in `directory`.
// The same events give the same bytes.
class BusLog {
 public:
  // `directory` must exist.
  BusLog(const std::filesystem::path& directory, const std::vector<int>& robot_ids);
  // One message; `robot_id` says whose onboard bus it was on and does not matter on the swarm bus.
  void write(BusId bus, int robot_id, Utime utime, std::string_view channel, std::span<const std::uint8_t> bytes);
  void close();

 private:
  struct Log {
    explicit Log(const std::filesystem::path& path);
    AtomicFile file;
    lcm::LogFile log;
  };
  std::map<int, Log> logs_;  // by robot id
};

}  // namespace swarm
