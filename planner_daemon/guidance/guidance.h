// The way to the goal through all that is known to stand still, from everywhere.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "planner_daemon/guidance/global_map.h"
#include "planner_daemon/guidance/wavefront.h"

namespace swarm {

class Guidance {
 public:
  static constexpr int kCell = 2;           // voxels along each edge of what a cost is kept for
  static constexpr double kBeside_m = 0.8;  // so far from a goal that is blocked the way may end

  // As GlobalMap, and throws what it throws.
  Guidance(const std::string& static_map, const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max,
           bool explores = false)
      : map_(static_map, space_min, space_max, explores) {}

  // What stands still in the newest SOGM, see GlobalMap::see(). `seen` may be null. For another goal the ways are
  // worked out at once, in a map beyond some 10,000 m2 also in the next work()s, straight ones serving until then; when
  // the map changed, bit by bit in work(), while those there are still serve. To be called now and then, with work() in
  // between.
  void update(const Sogm& sogm, const Sogm& standing, const Sogm* seen, const Eigen::Vector3d& goal, double blocked_m);
  // Where no way leads from `place`, forgets what was seen: it may be gone since.
  void reconsider(const Eigen::Vector3d& place);
  // The goal, and what was seen.
  void forget();
  // A little of what is to do.
  void work();

  // What stands in a building that is known, see GlobalMap::known().
  const Sogm* known() const { return map_.known(); }
  // Nothing stands between anywhere and the goal, or nothing is known: the way is straight.
  bool empty() const { return empty_; }
  // No way leads from `place` to the goal, by all that is known to stand still: the goal lies in it, beyond the flight
  // space, or behind it. A person who stands in a door may do so as well.
  bool is_unreachable(const Eigen::Vector3d& place) const;
  // From the voxel of the lattice [Wavefront::Cost]; kUnreached: there is no way. Beyond what is known, straight.
  int cost(const Eigen::Vector3i& voxel) const;
  // The same of the voxels from `first` on, `step` apart.
  void costs(const Eigen::Vector3i& first, const Eigen::Vector3i& step, std::span<int> costs) const;
  // As if nothing were in the way.
  int straight_cost(const Eigen::Vector3i& voxel) const { return Wavefront::straight_cost(voxel - goal_voxel_); }

 private:
  struct Field {
    Wavefront front;
    GridGeometry grid;
    double beside_goal = 0.0;  // so far from it the ways end [voxels]
  };

  bool leads_from(const Eigen::Vector3d& place) const;
  void begin();
  void work_on(std::int64_t words);

  GlobalMap map_;
  Eigen::Vector3d goal_ = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  double resolution_m_ = 0.0;                             // of the SOGM
  Eigen::Vector3i goal_voxel_ = Eigen::Vector3i::Zero();  // of the lattice
  std::array<Field, 2> fields_;
  std::vector<int> column_;  // scratch of begin()
  int serves_ = 0;           // of fields_: complete
  bool empty_ = true, works_ = false, is_stale_ = false;
  bool has_worked_ = true;  // since the newest update()
  bool is_urgent_ = false;  // for another goal, and nothing serves
};

}  // namespace swarm
