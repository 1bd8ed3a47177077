// Configuration space of a spherical robot: where its centre may not be, where it had rather not be, and how near it
// comes to a collision. One definition of free for search, corridor and check.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "map_daemon/dilation.h"
#include "planner_daemon/space/occupancy.h"
#include "planner_daemon/space/peer.h"
#include "planner_daemon/space/reachability.h"
#include "planner_daemon/space/swept_volume.h"
#include "planner_daemon/space/walls.h"

namespace swarm {

struct ConfigurationSpaceOptions {
  double radius_m = 0.2;               // of the robot's sphere
  double clearance_m = 0.05;           // free: farther than radius + clearance from every occupied voxel's centre
  double emergency_clearance_m = 0.0;  // in an emergency: the clearance that is given up last before a collision
  double collision_depth_m = 0.04;     // a voxel's centre this far inside the radius means a collision
  double inflation_m = 0.15;           // beyond the clearance: avoided where that costs little
  double recently_occupied_s = 0.5;    // where an obstacle was until this long before is avoided: it may turn
  double silent_peer_margin_m = 0.5;   // around peers that have fallen silent: avoided like what was recently occupied
  double clock_error_s = 0.01;         // peers come so much earlier or later, at most: their clocks differ from ours

  double blocked_m() const { return radius_m + clearance_m; }
};

// How bad it is for the robot's centre to be in a voxel of blocked space.
enum class Severity : std::uint8_t { kBlocked, kEmergency, kCollision };

// Everything is worked out tile by tile where it is looked at, which is a small part of what the robot can come to; to
// look is to ask with the region, so nobody can look at what was not worked out. Keeps its memory: a map for each
// layer.
class ConfigurationSpace {
 public:
  // `static_map`: OctoMap file; empty: none. Throws what Walls throws.
  explicit ConfigurationSpace(const ConfigurationSpaceOptions& options, const std::string& static_map = "")
      : options_(options), walls_(static_map, options.radius_m) {}
  ConfigurationSpace(const ConfigurationSpace&) = delete;  // occupancy() refers to parts of this
  ConfigurationSpace& operator=(const ConfigurationSpace&) = delete;

  // The space around what `sogm` holds and what the peers sweep within `reachable`; what blocks keeps off `margin_m`
  // beyond the clearance. `seen`: a SEEN_SPACE; what it did not see is not known to stand, and to come too close to it
  // is never worse than kEmergency. Null: all is seen. Refers to `sogm` until the next call.
  void compose(const Sogm& sogm, const std::vector<Peer>& peers, const ReachableSet& reachable, double margin_m = 0.0,
               const Sogm* seen = nullptr);
  // What stands still in every frame, peers that hover among it, in the whole window: one frame. Valid until the next
  // call.
  Occupancy compose_standing(const std::vector<Peer>& peers);
  // Adds to it what of `known`, one frame of any geometry, is not seen. Null: nothing.
  void add_known(const Sogm* known);
  // What of the window is seen: one frame; null: all.
  const Sogm* seen() const { return sees_all_ ? nullptr : &seen_; }

  // So far the centre keeps from the middles of occupied voxels, in what was composed.
  double blocked_m() const { return options_.blocked_m() + margin_m_; }
  // So far ways keep from the middles of voxels where something stands still, whatever the margin: it passes. More than
  // what blocks the centre where walls do so by exact distance.
  double way_m() const { return std::max(options_.blocked_m(), walls_.way_m()); }

  const Occupancy& occupancy() const { return occupancy_; }
  // With the margin around silent peers; none: no such peer is near.
  std::optional<Occupancy> with_silent_peer_margin() const {
    if (silent_peers_.empty()) return {};
    return Occupancy{occupancy_.sogm, &peers_, &silent_peers_};
  }
  // Layout of all layers: geometry, frames and their times as in the SOGM. Its voxels are known where layers() or
  // blocked() were asked for them.
  const Sogm& grid() const { return blocked_.sogm; }

  // Where all that blocks the centre lies in the window: beyond, nothing is known.
  Eigen::AlignedBox3d known() const;
  // Where the centre may not be, worked out at least in these columns of frames first to last; beyond the window
  // nothing is known.
  const Sogm& blocked(int first_frame, int last_frame, const Columns& columns);
  // Each holds the one before: what costs a path, layer by layer. Worked out at least there.
  struct Layers {
    const Sogm &blocked, &recently_occupied, &inflation;
  };
  Layers layers(int first_frame, int last_frame, const Columns& columns);
  // By exact distance, in halves of voxels, see Walls; never outside inflation.
  bool meets_wall(std::int32_t x, std::int32_t y, std::int32_t z) { return !walls_.empty() && walls_.meet(x, y, z); }
  bool has_walls() const { return !walls_.empty(); }
  // Of a voxel in blocked space: a bit of a word of its layer.
  Severity severity(std::size_t word, std::uint64_t bit);

  // Walls, by exact distance, among it.
  bool blocked_at(const Eigen::Vector3d& position, int frame);
  bool recently_occupied_at(const Eigen::Vector3d& position, int frame);
  // The first frame from which on, until `last_frame`, nothing was recently there; last_frame + 1: none.
  int clear_from(const Eigen::Vector3d& position, int last_frame);
  // None where it is free.
  std::optional<Severity> severity_at(const Eigen::Vector3d& position, int frame);
  // First time from `from` on at which the motion enters blocked space, or kNever: looked at every 10 ms, and
  // where it is fast every half voxel along the fastest axis, down to 1 ms; hover tail included.
  Utime first_blocked(const Motion& motion, Utime from);

 private:
  // What was worked out of a layer, by tile: in which round (composed space) last.
  using Rounds = std::vector<std::uint32_t>;
  // Occupied space dilated by a radius, where it is looked at.
  struct DilatedLayer {
    Sogm sogm;
    Dilator dilator;
    Rounds rounds;
  };

  std::size_t tile_at(int frame, int x, int y) const {  // in Rounds
    return static_cast<std::size_t>((frame * tiles_.x() + x) * tiles_.y() + y);
  }
  void add_peers(const std::vector<Peer>& peers, const ReachableSet& reachable);
  template <class WorkOut>
  void for_each_new_box(int first_frame, int last_frame, const Columns& columns, Rounds* rounds,
                        const WorkOut& work_out);
  const Occupancy& certain();
  const Sogm& look(int first_frame, int last_frame, const Columns& columns, DilatedLayer* layer);
  void work_out_inflation(int frame, const Columns& box);

  ConfigurationSpaceOptions options_;
  double margin_m_ = 0.0;
  Walls walls_;
  Occupancy occupancy_;
  SweptVolumes peers_, standing_peers_;
  SweptVolumes silent_peers_;    // with the margin around them
  std::vector<Columns> bounds_;  // by frame: where peers matter
  DilatedLayer blocked_, emergency_, collision_;
  Sogm recently_occupied_, inflation_;
  Dilator inflation_dilator_;
  Rounds inflation_rounds_;                          // of both
  Eigen::Vector2i tiles_ = Eigen::Vector2i::Zero();  // of a frame, along x and y
  std::uint32_t round_ = 0;
  int recent_frames_ = 0;  // so long something counts as recently occupied
  Sogm standing_;
  bool sees_all_ = true;
  Sogm seen_there_, seen_;  // in its own window, and in that of the map
  Sogm known_;              // of add_known(), in the window of the map
  Sogm certain_;            // what is occupied and was seen
  Occupancy certain_occupancy_;
  std::uint32_t certain_round_ = 0;
  std::vector<Layer> sources_;
  std::vector<std::size_t> standing_words_;  // not clear in the first frame and the last
};

}  // namespace swarm
