// The static heuristic: the way to the goal around what stands still in the window, hovering peers among it, and on
// from its edge by the guidance, so that the search does not run into dead ends between the robot and its goal (the
// paper names the want of guidance as its weakness, section VI).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "planner_daemon/guidance/guidance.h"
#include "planner_daemon/space/occupancy.h"

namespace swarm {

// Cells of the static and of the space-time heuristic: so many voxels along each edge, from the window's corner on. The
// middle voxel lies inside the window.
inline constexpr int kCellVoxels = 3;
constexpr int middle_of(int cell) {
  return kCellVoxels * cell + kCellVoxels / 2;
}
inline Eigen::Vector3i cells_in(const GridGeometry& grid) {
  return (grid.size.array() + (kCellVoxels - 1 - kCellVoxels / 2)) / kCellVoxels;
}

// Cells [first, last] of a column; none when the first is above the last.
struct CellSpan {
  int first = 0, last = -1;
  bool holds(int cell) const { return cell >= first && cell <= last; }
};
// Those of `num_cells` cells, the lowest with its bottom at `bottom_m`, that overlap (low_m, high_m).
CellSpan cells_between(double bottom_m, double cell_m, int num_cells, double low_m, double high_m);

class StaticHeuristic {
 public:
  // Ways lead through cells of two voxels along each edge, open where any of these is: eight times fewer. Walls that
  // are grown by kThickEnough voxels have no holes in cells either, however they stand; if `blocked_m` is less, and
  // with kVoxels, ways lead from voxel to voxel.
  enum class Detail { kCells, kVoxels };
  static constexpr double kThickEnough = 2.45;

  // Least ways to `goal` from every voxel that is farther than `blocked_m` from what is occupied in frame 0 of
  // `standing` and within the flight space `space`, W [m]. From the window's
  // edge the way goes on as `guidance` knows it; null: straight. Empty when nothing stands in the way.
  void build(const Occupancy& standing, double blocked_m, const Eigen::Vector3d& goal, const Eigen::AlignedBox3d& space,
             const Guidance* guidance, Detail detail = Detail::kCells);
  // The same through the window alone, in cells: from its edge no way goes on.
  void build_within(const Occupancy& standing, double blocked_m, const Eigen::Vector3d& goal,
                    const Eigen::AlignedBox3d& space);

  // It knows nothing that a straight way does not.
  bool empty() const { return empty_; }
  // The goal cannot be reached from where the robot, in the middle of the window, is.
  bool is_cut_off() const { return is_cut_off_; }

  // Where the way from `place` leads at first, when it is a detour of more than a metre: the last place on it that is
  // seen from there past all that stands still.
  struct Subgoal {
    Eigen::Vector3d position;  // W [m]
    int cost;                  // of Wavefront
  };
  std::optional<Subgoal> subgoal(const Eigen::Vector3d& place) const;
  // The last place on the way that is seen from `place`, at most `reach_m` of way ahead; none: there is no way, or it
  // is not known.
  std::optional<Subgoal> ahead(const Eigen::Vector3d& place, double reach_m) const;
  // Where the way from `place` ends when the goal itself is too close to what stands still, W [m]; none: it is not, or
  // there is no way.
  std::optional<Eigen::Vector3d> beside_goal(const Eigen::Vector3d& place) const;
  // Of the way from `place` [Wavefront::Cost].
  int cost(const Eigen::Vector3d& place) const;
  // Where somebody who comes to the goal from `other`, and flies on to the place inside `space` from which the way to
  // the goal is the longest, is let pass.
  struct Refuge {
    std::vector<Eigen::Vector3d> way;  // from cell to cell, W [m]
    Eigen::Vector3d place;
    bool is_apart;  // it is the nearest one that is farther than `apart_m` from that way; else the one at its end
  };
  // None: no place is reached.
  std::optional<Refuge> refuge(const Eigen::AlignedBox3d& space, const Eigen::Vector3d& other, double apart_m) const;

  // Word `w` of the column of the lattice at (x, y), from the voxel `z` of the lattice on: what stands still is too
  // close to these voxels. 0 beyond the window and where the goal cannot be reached.
  std::uint64_t blocked(int x, int y, int z, int w) const {
    x -= grid_.origin.x(), y -= grid_.origin.y();
    if (empty_ || is_cut_off_ || x < 0 || y < 0 || x >= grid_.size.x() || y >= grid_.size.y()) return 0;
    const int words = grid_.words_per_column();
    return word_of_column(blocked_.data() + (Eigen::Index{x} * grid_.size.y() + y) * words, words, w,
                          z - grid_.origin.z());
  }

  // Least ways to the goal [ticks, `per_cell` of them to a straight step of one cell], at most `far`, from the nearest
  // voxel of each cell; `far` where there is none. Of cells (x, y, z) with y in `first_y` and the following num_y - 1,
  // z in [0, num_z): to `out`, columns `stride` apart, with `far` in between. Cells of a window like that of build()
  // that begins at `origin` of the lattice: a little later it has moved with the robot. The least of the cells of ways
  // that overlap.
  void ticks(const Eigen::Vector3i& origin, int x, int first_y, int num_y, int num_z, std::size_t stride, int per_cell,
             std::int16_t far, std::int16_t* out) const;

  static int ticks_of(int cost, int per_cell) { return cost * per_cell / (kCellVoxels * Wavefront::kStraight); }

 private:
  // False: nothing stands in the window.
  bool lay_out(const Occupancy& standing, double blocked_m, const Eigen::Vector3d& goal,
               const Eigen::AlignedBox3d& space, Detail detail);
  void open_cells();  // where any of their voxels is
  void advance();
  void seed_goal();
  // From the outermost voxels on, where the way goes on: by the guidance, or straight (null).
  void seed_edge(const Guidance* guidance);
  void find_costs_of_layer(const Guidance* guidance, int z, std::vector<int>* leaving);
  void find_costs_beyond(const Guidance* guidance, const Eigen::Vector3i& at, const Eigen::Vector3i& step,
                         std::span<int> costs);
  // All cells of one height, by x and y, and kLayerRim more around them.
  static constexpr int kLayerRim = Guidance::kCell;
  std::size_t row_of_layer() const { return static_cast<std::size_t>(size_.y() + 2 * kLayerRim); }
  std::size_t at_in_layer(int x, int y) const {
    return static_cast<std::size_t>(x + kLayerRim) * row_of_layer() + static_cast<std::size_t>(y + kLayerRim);
  }
  bool is_open(const Eigen::Vector3i& voxel) const {  // wherever the flight space ends
    const Eigen::Index words = grid_.words_per_column();
    const Eigen::Index at = (Eigen::Index{voxel.x()} * grid_.size.y() + voxel.y()) * words + voxel.z() / 64;
    return grid_.contains(voxel) && (blocked_[static_cast<std::size_t>(at)] >> voxel.z() % 64 & 1) == 0;
  }
  int cost_at(const Eigen::Vector3i& cell) const {
    return std::min<int>(Wavefront::kUnreached, cell_voxels_ * front_.cost(cell));
  }
  double cell_m() const { return cell_voxels_ * grid_.resolution_m; }
  // Of the lattice too: they stay where they are while the window moves.
  int lattice_cell(int voxel) const { return voxel >> (cell_voxels_ - 1); }
  Eigen::Vector3i lattice_cell(const Eigen::Vector3i& voxel) const {
    return {lattice_cell(voxel.x()), lattice_cell(voxel.y()), lattice_cell(voxel.z())};
  }
  // Place in cells of the window.
  Eigen::Vector3d in_cells(const Eigen::Vector3d& place) const { return place / cell_m() - first_cell_.cast<double>(); }
  bool has_cell(const Eigen::Vector3i& cell) const {
    return (cell.array() >= 0).all() && (cell.array() < size_.array()).all();
  }
  // The cell of a place (in cells), or the nearest one around it from which a way leads; none: there is none.
  std::optional<Eigen::Vector3i> start_of(const Eigen::Vector3d& from) const;
  bool sees(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const;  // in cells of the window
  // The cheapest of the cells around one; itself: there is none cheaper.
  Eigen::Vector3i next_of(const Eigen::Vector3i& cell) const;
  // Down the costs from `place` to the last place that is seen from there, above the cost `least`.
  std::optional<Subgoal> descend(const Eigen::Vector3d& place, int least) const;

  bool empty_ = true, is_cut_off_ = false;
  GridGeometry grid_;                                     // the window
  Eigen::Vector3i goal_ = Eigen::Vector3i::Zero();        // voxel of the lattice
  int cell_voxels_ = 1;                                   // along each edge: 1 or 2
  Eigen::Vector3i first_cell_ = Eigen::Vector3i::Zero();  // of the lattice
  Eigen::Vector3i size_ = Eigen::Vector3i::Zero();        // cells
  Dilator dilator_;
  std::vector<Layer> layers_;
  std::vector<std::uint64_t> blocked_;                                                 // columns
  Columns inside_columns_;                                                             // within the flight space
  std::vector<std::uint64_t> inside_;                                                  // of each of them: the same
  std::vector<std::uint64_t> inside_row_, open_row_, column_;                          // scratch of open_cells()
  std::vector<int> layer_, leaving_below_, leaving_above_, leaving_beside_, farther_;  // scratch of seed_edge()
  std::vector<Eigen::Vector3i> ends_;  // voxels of the lattice where ways end, when the goal is closed
  Wavefront front_;
  mutable std::vector<Wavefront::Cost> rows_, sampled_, nearest_;  // scratch of ticks()
};

}  // namespace swarm
