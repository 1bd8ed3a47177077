// From the scans of range sensors to what map_daemon draws: what stands, what moves and how fast, and what was seen at
// all. Moving obstacles are tracked by the tracker of the map daemon, from the same reports that it gets.
#pragma once

#include <cstdint>
#include <map>
#include <memory_resource>
#include <span>
#include <string>
#include <vector>

#include "map_daemon/perception/clusters.h"
#include "map_daemon/perception/free_space_grid.h"
#include "map_daemon/perception/kept_map.h"
#include "map_daemon/perception/peer_mask.h"
#include "map_daemon/perception/range_scan.h"
#include "map_daemon/perception/round_fit.h"
#include "map_daemon/static_map.h"
#include "map_daemon/tracker.h"
#include "sogm_swarm/obstacles_t.hpp"

namespace swarm {

struct PerceptionConfig {
  ScanConfig scan;
  double resolution_m = 0.1;  // of the grid
  double memory_s = 10.0;     // what was not seen for so long is unknown
  double body_m = 0.2;        // so near to a sensor nothing is but the robot
  double begin_m = 0.45;      // and so near to where it looks first: somebody put the robot there
  std::string static_map;     // OctoMap file of what stands and is no obstacle; empty: none
  bool explores = true;       // besides it there is a building: what is seen stands until it is seen to move
  double pose_m = 0.01;       // of the sensor's position
  double pose_rad = 0.005;    // and of its direction
  // Whoever goes out of sight may turn there: its track goes on for a shorter time than map_daemon's, which is drawn.
  TrackerConfig tracks{.timeout_s = 0.6};
};

// Whether the track's velocity is more than the errors of its positions make.
bool moves(const Track& track);

class Perception {
 public:
  // Throws what StaticMap throws.
  explicit Perception(const PerceptionConfig& config);

  // One scan. `robots`: what in it is no obstacle. `header`: of the report.
  void update(const RangeScan& scan, std::span<const PeerMask::Ball> robots, const sogm_swarm::header_t& header);

  // The obstacles that the newest scan saw: columns, by the ids of their tracks. What never moved is tracked, but is no
  // obstacle yet: it stands, see below. They have no velocities but for the first report of what was tracked before.
  const sogm_swarm::obstacles_t& report() const { return report_; }
  // Two frames: what stands (what moves is left out), and what was not seen.
  const Sogm& seen_space() const { return seen_space_; }
  const Tracker& tracker() const { return tracker_; }
  const FreeSpaceGrid& grid() const { return grid_; }
  // A track that is in reports; and moves.
  bool is_told(const Track& track) const {
    const auto form = forms_.find(track.id);
    return form != forms_.end() && form->second.is_told;
  }
  bool is_moving(const Track& track) const { return is_told(track) && moves(track); }
  // Surfaces that the newest scan saw of what moves, W [m].
  const std::vector<Eigen::Vector3d>& moving_points() const { return moving_points_; }
  int points() const { return points_; }
  int masked() const { return masked_; }
  // What was known to stand stands where nothing else is known.
  void recall(const KeptMap& map) { map.recall(&grid_); }
  // Where the sensors were is not known any more.
  void forget();
  // The clock was set by `step`.
  void shift(Duration step) { grid_.shift(step), tracker_.shift(step); }

 private:
  // What a track's shape was found to be.
  struct Form {
    bool is_round = false;
    Eigen::Vector2d first = Eigen::Vector2d::Zero();  // where it was seen first, W [m]
    double first_height_m = 0.0;                      // of its surfaces
    bool moved = false;                               // at some time since
    bool is_told = false;                             // in the newest report
    RadiusPrior radius;
    double top_m = 0.0, bottom_m = 0.0;
    bool has_top = false, has_bottom = false;  // seen to end there
  };
  // A track where it should be at the time of the scan.
  struct Expected {
    std::int32_t id;
    Eigen::Vector2d center;
    double gate_m;
    const Form* form;
  };
  using Points = std::pmr::vector<int>;  // indices of surfaces_
  struct Piece {
    std::int32_t id;  // of its track; kNew
    Points points;
    const Cluster* cluster;
    Eigen::Vector2d center = Eigen::Vector2d::Zero();  // W [m]
    double sigma_m = 0.0;                              // of it
    RadiusPrior radius{};
    bool is_round = false;
    bool is_cut = false;  // nothing was seen beside one of its sides
  };

  void look(const RangeScan& scan, std::span<const PeerMask::Ball> robots);
  void expect_tracks(Utime utime);
  // Divides a cluster among the tracks that it may be of, and what is left.
  void divide(const Cluster& cluster, const RangeScan& scan);
  // Finds where a track is by points that may be of it; which are not, is left. False: nowhere.
  bool fit_track(const Expected& track, const RangeScan& scan, Piece* piece, Points* left);
  void add_new_pieces(const Cluster& cluster, const RangeScan& scan, Points points);
  void add_rounds(const Cluster& cluster, const RangeScan& scan, Points* points);
  void take_round(const RoundFit& fit, Points* points, Piece* piece);
  void add_tiles(const Cluster& cluster, std::span<const int> points);
  // Beside how many of the two sides of these points it is seen to be free, and beside how many the sensor does not
  // look.
  struct Sides {
    int free = 0, out_of_view = 0;
  };
  Sides sides_of(std::span<const int> points, const RangeScan& scan) const;
  static RadiusPrior prior_of(const RadiusPrior& known, bool cut);
  bool fit_new(const RangeScan& scan, Piece* piece);
  bool has_moved(std::span<const int> points) const;
  bool is_alone(const Cluster& cluster, const RangeScan& scan) const;
  bool has_left(const Piece& piece, const Form& form) const;
  bool may_move(const RoundFit& fit, const RangeScan& scan, Piece* piece);
  void surround(Piece* piece);
  void report_piece(const Piece& piece, const RangeScan& scan);
  void mark_moving();
  void draw_seen_space(Utime utime);
  std::span<const Eigen::Vector2d> seen_from_above(std::span<const int> points);

  PerceptionConfig config_;
  // What the scans before needed serves the next ones.
  std::pmr::unsynchronized_pool_resource memory_{{.max_blocks_per_chunk = 16, .largest_required_pool_block = 1 << 20}};
  StaticMap static_map_;  // and what is so near to it that it is of it
  FreeSpaceGrid grid_;
  ClusterFinder finder_;
  Tracker tracker_;
  std::pmr::map<std::int32_t, Form> forms_{&memory_};  // of tracks, by id
  std::int32_t next_id_ = 0;
  bool has_begun_ = false;

  // Of the newest scan.
  std::vector<Eigen::Vector3d> surfaces_;
  std::vector<Eigen::Vector3i> voxels_;  // of these, in the window of the grid
  std::vector<Eigen::Vector3d> moving_points_;
  int points_ = 0, masked_ = 0;
  std::vector<Expected> expected_;
  std::vector<Piece> pieces_;
  std::vector<Eigen::Vector2d> from_above_;
  sogm_swarm::obstacles_t seen_{}, report_{};  // with what is only tracked, and without
  Sogm seen_space_;
};

}  // namespace swarm
