// What the tests of the planner daemon's node stand on: the node, and what it hears.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <utility>
#include <vector>

#include "lcmtypes/bus/channels.h"
#include "planner_daemon/planner_node.h"
#include "tests/support/harness.h"

namespace swarm::test {

using sogm_swarm::announcement_t;
using sogm_swarm::candidate_t;
using sogm_swarm::corridors_t;
using sogm_swarm::goal_t;
using sogm_swarm::planner_status_t;
using sogm_swarm::sogm_t;

inline constexpr int kRobot = 3;
inline const Eigen::Vector3d kHome(0, 0, 1);

// Robot 3 at rest at kHome, in a window of 10 x 10 x 4 m around it.
class PlannerNodeFixture : public Bench<PlannerNode> {
 public:
  explicit PlannerNodeFixture(const PlannerNodeConfig& config = make_config(), Stopwatch stopwatch = nullptr,
                              bool publish_durations = true)
      : Bench(config, 5, std::move(stopwatch), publish_durations) {
    map.reset({.resolution_m = 0.1, .origin = {-50, -50, -10}, .size = {100, 100, 40}}, 20, Utime(), 100ms);
  }
  static PlannerNodeConfig make_config() {
    PlannerNodeConfig config;
    config.robot_id = kRobot;
    config.calm_period_s = 0.0;  // a plan for each map
    config.planner.limits.space_min = {-8, -8, 0.2};
    config.planner.limits.space_max = {8, 8, 3.8};
    return config;
  }

  // `map` as the map daemon sends it, built `age_s` ago.
  std::vector<sogm_t> map_parts(double age_s = 0.0) {
    map.start_utime = now - to_duration(age_s);
    const auto parts = encoder_.encode(map, make_header(kRobot, 1, map_seq_++, map.start_utime));
    return {parts.begin(), parts.end()};
  }
  void send_map(double age_s = 0.0) {
    for (const sogm_t& part : map_parts(age_s)) send(channel::kSogm, part);
  }
  void send_own(const Motion& motion) {
    send(channel::kOwnTrajectory, announcement(kRobot, motion.committed, motion.next, announcement_t::kCommitted));
  }
  void send_hover() { send_own({Trajectory::hover(1, now, kHome), {}}); }
  void send_peer(int id, const Trajectory& committed, const Trajectory& pending = {},
                 std::int8_t state = announcement_t::kCommitted) {
    send(channel::kPeerTrajectory, announcement(id, committed, pending, state));
  }
  void send_goal(const Eigen::Vector3d& position) {
    goal_t goal = to_goal({{position}});
    goal.header = make_header(kRobot, 1, goal_seq_++, now);
    send(channel::kGoal, goal);
  }
  announcement_t announcement(int id, const Trajectory& committed, const Trajectory& pending, std::int8_t state,
                              Utime stamp = {}) {
    announcement_t message{};
    message.header = make_header(id, 1, announcement_seq_++, now);
    message.radius = 0.2f;
    message.committed = committed.to_wire();
    message.pending = pending.to_wire();
    message.pending_state = pending.empty() ? announcement_t::kNone : state;
    message.pending_stamp = to_us(stamp);
    message.num_acks = num_acks;
    message.acks.resize(static_cast<std::size_t>(num_acks));
    return message;
  }
  void start(const Eigen::Vector3d& goal) {
    send_hover();
    send_goal(goal);
    send_map();
  }
  void occupy(const Eigen::Vector3d& low, const Eigen::Vector3d& high, int first_frame = 0) {
    for (int frame = first_frame; frame < map.num_frames; ++frame) {
      for (double x = low.x() + 0.05; x < high.x(); x += 0.1) {
        for (double y = low.y() + 0.05; y < high.y(); y += 0.1) {
          for (double z = low.z() + 0.05; z < high.z(); z += 0.1) {
            const Eigen::Vector3i voxel = map.geometry.voxel_of({x, y, z});
            if (map.geometry.contains(voxel)) {
              map.column(frame, voxel.x(), voxel.y())[voxel.z() / 64] |= std::uint64_t{1} << voxel.z() % 64;
            }
          }
        }
      }
    }
  }
  Trajectory planned() const { return Trajectory::from_wire(out.newest<candidate_t>(channel::kCandidate).trajectory); }
  planner_status_t status() const { return out.newest<planner_status_t>(channel::kPlannerStatus); }

  Sogm map;
  std::int16_t num_acks = 2;  // of announcements; 0: as in cells

 private:
  SogmEncoder encoder_;
  std::int64_t map_seq_ = 0, announcement_seq_ = 0, goal_seq_ = 0;
};

inline Eigen::Vector3d end_of(const Trajectory& trajectory) {
  return trajectory.at(trajectory.end_utime()).position;
}

}  // namespace swarm::test
