// Configuration space of a spherical robot, in zones: where its centre may not be, where it had rather not be, and how
// near it comes to a touch. One definition of free for search, corridor and check.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "map_daemon/dilation.h"
#include "planner_daemon/space/reachability.h"
#include "planner_daemon/space/swept_volume.h"
#include "planner_daemon/space/zone_source.h"

namespace swarm {

struct ZoneOptions {
  double radius_m = 0.2;        // of the robot's sphere
  double clearance_m = 0.05;    // free: farther than radius + clearance from every occupied voxel's centre
  double tight_m = 0.0;         // in an emergency: the clearance that is given up last before a touch
  double contact_m = 0.04;      // a voxel's centre this far inside the radius means a touch
  double comfort_m = 0.15;      // beyond the clearance: avoided where that costs little
  double wake_s = 0.5;          // where an obstacle was until this long before is its wake: it may turn
  double berth_m = 0.5;         // around peers that have fallen silent: like a wake
  double clock_error_s = 0.01;  // peers come so much earlier or later, at most: their clocks differ from ours

  double blocked_m() const { return radius_m + clearance_m; }
};

struct Peer {
  Motion motion;
  Trajectory announced;  // waits for acknowledgements: occupied too; may be empty
  double radius_m = 0.2;
  bool silent = false;  // has not been heard for a while
  // Its centre stays within, whichever it flies [m]; peers out of reach cost a look at this.
  Eigen::AlignedBox3d space{Eigen::Vector3d::Constant(-1e6), Eigen::Vector3d::Constant(1e6)};
};
// For Peer::space: the hull of all pieces.
Eigen::AlignedBox3d space_of(const Motion& motion, const Trajectory& announced);

// First time in [from, until] at which an occupied voxel's centre lies within `radius_m` of the motion, or INT64_MAX.
// Of the map alone: peers are not in it.
std::int64_t first_touch(const Sogm& sogm, const Motion& motion, double radius_m, std::int64_t from_utime,
                         std::int64_t until_utime);

// The zones are worked out tile by tile where they are looked at, which is a small part of what the robot can come to.
// Keeps its memory: a map for each zone.
class Zones : public ZoneSource {
 public:
  explicit Zones(const ZoneOptions& options) : options_(options) {}
  Zones(const Zones&) = delete;  // occupancy() refers to parts of this
  Zones& operator=(const Zones&) = delete;

  // The zones around what `sogm` holds and what the peers sweep where `reach` comes to. Refers to `sogm` until the next
  // call.
  void compose(const Sogm& sogm, const std::vector<Peer>& peers, const Reach& reach);
  // What stands still in every frame, peers that hover among it, in the whole window: one frame. Valid until the next
  // call.
  Occupancy compose_standing(const std::vector<Peer>& peers);

  const Occupancy& occupancy() const { return occupancy_; }
  void prepare_blocked(int first_frame, int last_frame, const Columns& columns) override;
  void prepare(int first_frame, int last_frame, const Columns& columns) override;

  // Where prepared:
  const Sogm& blocked() const { return blocked_; }
  const Sogm& wake() const { return wake_; }    // holds what is blocked
  const Sogm& near() const { return near_; }    // holds the wake
  const Sogm& tight() const { return tight_; }  // in an emergency
  const Sogm& contact() const { return contact_; }
  bool blocked_at(const Eigen::Vector3d& position, std::int64_t utime);
  // First time from `from_utime` on at which the motion enters the blocked zone, or INT64_MAX (fine sampling, hover
  // tail included).
  std::int64_t first_blocked(const Motion& motion, std::int64_t from_utime);

  // From now on tight and contact zones are worked out beside the blocked one.
  void enter_emergency() { emergency_ = true; }

 private:
  void add_peers(const std::vector<Peer>& peers, const Reach& reach);
  template <class WorkOut>
  void for_each_new_box(int first_frame, int last_frame, const Columns& columns, std::vector<std::uint32_t>* rounds,
                        const WorkOut& work_out);
  void dilate(int frame, const Columns& box, Dilator* dilator, Sogm* zone);
  void work_out_near(int frame, const Columns& box);

  ZoneOptions options_;
  Occupancy occupancy_;
  SweptVolumes peers_, standing_peers_;
  SweptVolumes berths_;          // of those that are silent, the berth around them in it
  std::vector<Columns> bounds_;  // by frame: where peers matter
  Sogm blocked_, tight_, contact_, wake_, near_, still_;
  Eigen::Vector2i tiles_ = Eigen::Vector2i::Zero();                             // of a frame, along x and y
  std::vector<std::uint32_t> blocked_rounds_, near_rounds_, emergency_rounds_;  // by tile: when it was worked out
  std::uint32_t round_ = 0;
  int frames_back_ = 0;  // that a wake lasts
  bool emergency_ = false;
  Dilator blocked_dilator_, near_dilator_, tight_dilator_, contact_dilator_;
  std::vector<Layer> layers_;
  std::vector<std::size_t> still_words_;  // not clear in the first frame and the last
};

}  // namespace swarm
