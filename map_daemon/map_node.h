// The map daemon's node: builds the SOGM (paper section III-B) around the robot from the static map and the tracked
// obstacles, each predicted at constant velocity, at once when obstacles arrive and at a least rate without them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/receive.h"
#include "lcmtypes/bus/recurring.h"
#include "map_daemon/obstacle.h"
#include "map_daemon/sogm_codec.h"
#include "map_daemon/static_map.h"
#include "map_daemon/tracker.h"

namespace swarm {

struct MapConfig {
  int robot_id = 0;
  Eigen::Vector3d least_window_m{10, 10, 4};  // edges of the window, centred at the robot
  double resolution_m = 0.0;                  // voxel edge; 0: 0.1, or near it what fits the static map
  double frame_s = 0.1;                       // duration of one frame
  double horizon_s = 2.0;                     // a whole number of frames
  double v_max_mps = 2.0, a_max_mps2 = 6.0;   // of the robot, per axis: it must be able to stop inside the window
  std::string static_map;                     // OctoMap file; empty: none
  double margin_m = 0.0;           // voxels whose centres come half a voxel and this close to obstacles are occupied
  double growth_mps = 0.0;         // the margin grows by this per second of prediction
  double max_rate_hz = 30.0;       // of maps; faster than obstacles arrive, or maps wait for their turn
  double min_rate_hz = 10.0;       // of maps while no obstacles arrive
  TrackerConfig tracks;            // of reported obstacles
  double track_margin = 1.0;       // the margin grows by so many standard deviations of where an obstacle is
  double track_growth = 0.5;       // and the growth by so many of its velocity
  bool perception = false;         // no maps without what a perception_daemon has just seen
  std::string unknown = "near";    // what SEEN_SPACE does not know: free, near (occupied, where it is near) or occupied
  double unknown_near_m = 1.5;     // so near to the robot
  double unknown_beside_m = 0.25;  // so near beside what was seen free it is free, too
  bool explores = true;            // more may stand than the static map holds: above and below that nothing is free
  double state_timeout_s = 0.5;    // no maps with an older robot state
  double clock_limit_s = 0.1;      // messages from further in the future are refused

  int num_frames() const;
  Eigen::Vector3d window_m() const;  // the least one, sideways also what stopping takes
  Eigen::Vector3i voxels() const;    // of the window
  double voxel_m() const { return resolution_m > 0.0 ? resolution_m : StaticMap::kUsualVoxel_m; }
  double reach_m() const { return 0.5 * voxel_m() + margin_m; }  // from an obstacle to centres of occupied voxels
};

void declare(OptionSet& options, MapConfig& config);
// Throws OptionError on combinations that cannot work.
void verify(const MapConfig& config);

class MapNode : public Node {
 public:
  // `boot`: grows at every start. `stopwatch` null: durations are 0; they are published only with `publish_durations`.
  // Throws what verify() and StaticMap throw.
  MapNode(const MapConfig& config, std::int32_t boot, Stopwatch stopwatch = nullptr, bool publish_durations = true);

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;
  bool on_clock_step(Utime now, Duration step) override;
  Activity activity(Utime now) const override;

  double build_ms() const { return build_ms_; }  // of the newest map, encoding included
  int maps() const { return maps_; }             // published since start
  const RefusalCounts& refused() const { return refused_; }

 private:
  struct VoxelObstacle {
    Obstacle obstacle;
    Utime reported_utime;
  };

  Refusal on_state(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_obstacles(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_seen_space(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_voxels(Utime now, std::span<const std::uint8_t> bytes);
  // How old inputs may be, and how far ahead.
  TimeWindow window(Utime now) const;
  // Whether what was said at `utime` still counts; after the clock was set back, it may lie in the future.
  bool fresh(Utime utime, double timeout_s, Utime now) const;
  std::int16_t state(Utime now) const;  // map_status_t::k...
  void forget_unreported(Utime now);
  bool sees(Utime now) const;
  void build(Utime now);
  void add_unknown(const Eigen::Vector3d& center);
  void publish_map(Outbox& outbox);
  void publish_status(Utime now, Outbox& outbox);

  MapConfig config_;
  std::optional<StaticMap> static_map_;
  Stopwatch stopwatch_;
  bool publish_durations_;
  HeaderSource map_headers_, status_headers_;
  RefusalCounts refused_;
  SequenceGate state_gate_, obstacle_gate_, voxel_gate_;

  bool has_state_ = false;
  Eigen::Vector3d position_, velocity_;  // of the robot at state_utime_, W
  Utime state_utime_{};
  Tracker tracker_;                                        // of OBSTACLES
  std::map<std::int32_t, VoxelObstacle> voxel_obstacles_;  // by id

  SogmAssembler seen_parts_;
  Sogm seen_;  // two frames: what stands, and what was not seen; none before the first
  bool obstacles_are_new_ = false;
  Recurring build_, status_;
  Sogm sogm_;
  Sogm seen_free_, beside_, known_;  // on the way to what is unknown
  SogmEncoder encoder_;
  std::int32_t maps_ = 0, maps_at_last_status_ = 0;
  double build_ms_ = 0.0;
};

}  // namespace swarm
