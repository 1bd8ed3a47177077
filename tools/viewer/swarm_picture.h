// What the buses say of the swarm, for whoever looks: the newest message of every kind from every robot, how often they
// come and what was refused. Fed by live buses or by a log; it decides nothing.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "lcmtypes/bus/codec.h"
#include "map_daemon/sogm_codec.h"
#include "planner_daemon/trajectory/motion.h"
#include "tools/logs/scan_picture.h"

namespace swarm {

// Messages of one kind from or about one robot.
class Traffic {
 public:
  // Whether the message is newer than what came before by (boot, seq). After a second of silence whatever comes is: a
  // log may be played again.
  bool is_news(Utime now, const sogm_swarm::header_t& header) const;
  void count(Utime now, const sogm_swarm::header_t& header);

  double rate_hz(Utime now) const;  // over the last second
  double age_s(Utime now) const { return to_seconds(now - newest_); }
  bool is_fresh(Utime now) const;                    // heard within the last second
  std::int64_t missing() const { return missing_; }  // numbers that never came, since the sender's start
  std::int64_t heard() const { return heard_; }

 private:
  static constexpr std::size_t kMost = 2000;  // that are counted for the rate
  std::deque<Utime> arrivals_;                // within the last second before the newest
  Utime newest_{};
  std::int64_t heard_ = 0, missing_ = 0, seq_ = -1;
  std::int32_t boot_ = -1;
};

// A grid that comes in parts: maps, and what was seen.
class GridPicture {
 public:
  bool was_heard() const { return was_heard_; }   // some part of one came
  const Sogm& newest() const { return newest_; }  // no frames: none came whole yet, or they are not kept
  std::int64_t count() const { return count_; }   // that came whole

 private:
  friend class SwarmPicture;
  Refusal keep(const sogm_swarm::sogm_t& part, bool was_silent);

  bool was_heard_ = false;
  Sogm newest_;
  std::int64_t count_ = 0;
  std::unique_ptr<SogmAssembler> assembler_;
};

struct RobotPicture {
  std::map<std::string, Traffic, std::less<>> traffic;  // by channel
  double radius_m = 0.0;                                // 0: not known yet
  Motion motion;                                        // what it is bound to; committed.empty(): not known
  Trajectory pending;                                   // waits for acknowledgements; empty: none
  Traffic announcements;                                // on whichever channel they came first
  std::optional<sogm_swarm::robot_state_t> state;
  std::optional<sogm_swarm::goal_t> goal;
  std::optional<sogm_swarm::obstacles_t> obstacles;
  std::optional<sogm_swarm::corridors_t> corridors;
  std::optional<sogm_swarm::map_status_t> map;
  std::optional<sogm_swarm::planner_status_t> planner;
  std::optional<sogm_swarm::broadcast_status_t> broadcast;
  std::optional<sogm_swarm::perception_status_t> perception;
  std::optional<sogm_swarm::flight_status_t> flight;
  std::optional<sogm_swarm::vehicle_status_t> vehicle;
  GridPicture sogm, seen_space;
  ScanPictures scans;

  // Where it is: measured, or else by what it flies. Nothing: not known.
  std::optional<Eigen::Vector3d> position(Utime now) const;
  // Where it flies to next, of its goals. Nothing: not known.
  std::optional<Eigen::Vector3d> next_goal() const;

 private:
  friend class SwarmPicture;
  void keep(Utime now, const sogm_swarm::announcement_t& message, PeerMask* masks);
};

class SwarmPicture {
 public:
  static constexpr std::size_t kMaxRobots = 128;  // the first ones heard of; messages about others are refused

  // `maps_of`: only this robot's maps and scans are put together and kept, which takes megabytes; -1: nobody's; none:
  // all.
  explicit SwarmPicture(std::optional<int> maps_of = {}) : maps_of_(maps_of) {}

  // One message of any channel; of channels that are none of ours nothing is kept. Refusals are
  // counted; what comes twice or late is none.
  Refusal add(Utime now, std::string_view channel, std::span<const std::uint8_t> bytes);

  const std::map<int, RobotPicture>& robots() const { return robots_; }
  // Obstacles that were told of within the last second, moved on to `now`: all that one source tells all robots of,
  // each by whoever told last; and what `looker` sees with its own sensors, which it numbers itself; -1: what each
  // sees.
  using ObstacleId = std::pair<int, int>;  // who sees it, -1: told to all; and its number
  std::map<ObstacleId, sogm_swarm::obstacle_t> obstacles(Utime now, int looker = -1) const;
  std::int64_t messages() const { return messages_; }  // taken or refused
  const RefusalCounts& refused() const { return refused_; }
  // How long before it came the content of the newest message was valid [s]: of clocks that differ, or a log.
  double newest_age_s() const { return to_seconds(newest_came_ - newest_utime_); }
  Utime newest_came() const { return newest_came_; }  // the epoch: none came

 private:
  template <class T>
  Refusal take(Utime now, std::string_view channel, const T& message);

  std::map<int, RobotPicture> robots_;
  PeerMask masks_ = usual_peer_mask();
  std::optional<int> maps_of_;
  std::int64_t messages_ = 0;
  Utime newest_utime_{}, newest_came_{};
  RefusalCounts refused_;
};

}  // namespace swarm
