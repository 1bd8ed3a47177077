#include "planner_daemon/guidance/global_map.h"

#include <algorithm>
#include <cmath>

#include "lcmtypes/bus/wide.h"
#include "map_daemon/octomap_file.h"

namespace swarm {
namespace {

constexpr int kTile = 8;            // columns along each edge of what stands still or not
constexpr double kNear_m = 3.0;     // sensors see everything there
constexpr double kSlack_m = 8.0;    // more than what must be held: it is laid out anew now and then only
constexpr double kSmall = 1 << 24;  // voxels of a flight space that is held as a whole
constexpr double kGoal_m = 40.0;    // goals farther from what is known wait until the robot comes closer
constexpr int kStrip = 64;          // columns along x that are dilated at once: little workspace

// The first multiple of kTile at or after `voxel`.
int tile_after(int voxel) {
  return (voxel + 1'000 * kTile * kTile + kTile - 1) / kTile * kTile - 1'000 * kTile * kTile;
}

SWARM_WIDE void add_row(const std::uint64_t* __restrict row, std::size_t n, std::uint64_t* __restrict sum) {
  for (std::size_t i = 0; i < n; ++i) sum[i] |= row[i];
}

// Columns of the first frame, those of one y united: words from the first y on.
void unite_along_x(const Sogm& sogm, const Columns& columns, std::vector<std::uint64_t>* sum) {
  const std::size_t n = static_cast<std::size_t>(columns.width() * sogm.geometry.words_per_column());
  sum->assign(n, 0);
  for (int x = columns.first.x(); x <= columns.last.x(); ++x)
    add_row(sogm.column(0, x, columns.first.y()), n, sum->data());
}

// Adds to `voxels`, those of a column, what hangs together with them above and below through `through`.
void spread_along_z(const std::vector<std::uint64_t>& through, std::vector<std::uint64_t>* voxels) {
  const auto spread = [&](std::size_t w, std::uint64_t beside, const auto& shifted) {
    std::uint64_t open = through[w], run = ((*voxels)[w] & open) | ((shifted((*voxels)[w], 1) | beside) & open);
    for (int step = 1; step < 64; step *= 2) {
      run |= open & shifted(run, step);
      open &= shifted(open, step);
    }
    (*voxels)[w] |= run;
  };
  const std::size_t n = voxels->size();
  for (std::size_t w = 0; w < n; ++w)
    spread(w, w == 0 ? 0 : (*voxels)[w - 1] >> 63, [](std::uint64_t word, int by) { return word << by; });
  for (std::size_t w = n; w-- > 0;)
    spread(w, w + 1 == n ? 0 : (*voxels)[w + 1] << 63, [](std::uint64_t word, int by) { return word >> by; });
}

}  // namespace

GlobalMap::GlobalMap(const std::string& static_map, const Eigen::Vector3d& space_min, const Eigen::Vector3d& space_max,
                     bool explores)
    : static_map_(static_map), space_min_(space_min), space_max_(space_max), explores_(explores) {
  if (!static_map_.empty()) tree_ = read_octomap(static_map_);
}

bool GlobalMap::see(const Sogm& sogm, const Sogm& standing, const Sogm* seen, const Eigen::Vector3d& goal,
                    double blocked_m) {
  if (blocked_m != blocked_m_) occupied_ = free_ = Sogm();
  blocked_m_ = blocked_m;
  const GridGeometry& window = sogm.geometry;
  bool changed = cover(window, goal);
  const GridGeometry& grid = occupied_.geometry;
  const int words = window.words_per_column(), grid_words = grid.words_per_column();
  const Eigen::Vector3i shift = window.origin - grid.origin;  // index in the window + shift = index here
  inside_.assign(static_cast<std::size_t>(grid_words), 0);    // of the window along z
  set_run(shift.z(), shift.z() + window.size.z() - 1, grid.size.z(), inside_.data());
  for (auto* column : {&look_, &stands_, &gone_, &through_}) column->resize(static_cast<std::size_t>(grid_words));
  // Far outside the flight space there is no grid.
  const bool goes_on = explores_ && seen != nullptr && !file_ && occupied_.num_frames > 0;
  if (goes_on && free_.num_frames == 0) free_.reset(grid, 1, Utime(), 1us);
  const Eigen::Vector2i first(tile_after(window.origin.x()), tile_after(window.origin.y()));
  const Eigen::Vector2d middle = window.size.head<2>().cast<double>() / 2.0;
  // Whether nothing that is seen changes in these columns.
  const auto is_still = [&](int x, int first_y) {
    const std::uint64_t *row = standing.column(0, x, first_y), *begin = sogm.column(0, x, first_y);
    const std::uint64_t* end = sogm.column(sogm.num_frames - 1, x, first_y);
    const std::uint64_t* look = seen != nullptr ? seen->column(0, x, first_y) : nullptr;
    std::uint64_t changes = 0;
    for (int i = 0; i < kTile * words; ++i)
      changes |= ((row[i] ^ begin[i]) | (row[i] ^ end[i])) & (look != nullptr ? look[i] : ~std::uint64_t{0});
    return changes == 0;
  };
  const auto is_clear = [](const std::vector<std::uint64_t>& united, int y, int n, int words_each) {
    const auto begin = united.begin() + y * words_each;
    return std::all_of(begin, begin + n * words_each, [](std::uint64_t word) { return word == 0; });
  };
  for (int tile_x = first.x() - window.origin.x(); tile_x + kTile <= window.size.x(); tile_x += kTile) {
    const Eigen::Vector2i offset = shift.head<2>();
    const Columns strip{Eigen::Vector2i(tile_x, 0).cwiseMax(-offset),
                        Eigen::Vector2i(tile_x + kTile, window.size.y()).cwiseMin(grid.size.head<2>() - offset) -
                            Eigen::Vector2i::Ones()};
    if (strip.empty()) continue;
    unite_along_x(standing, strip, &standing_);
    unite_along_x(occupied_, {strip.first + offset, strip.last + offset}, &known_);
    for (int tile_y = first.y() - window.origin.y(); tile_y + kTile <= window.size.y(); tile_y += kTile) {
      const Columns tile{{strip.first.x(), std::max(tile_y, strip.first.y())},
                         {strip.last.x(), std::min(tile_y + kTile - 1, strip.last.y())}};
      if (tile.empty()) continue;
      // Nothing stands there and nothing did: as most often.
      const int begin = tile.first.y() - strip.first.y();
      if (is_clear(standing_, begin, tile.width(), words) && is_clear(known_, begin, tile.width(), grid_words))
        continue;
      bool still = true;
      for (int x = tile_x; x < tile_x + kTile && still; ++x) still = is_still(x, tile_y);
      if (!still) continue;
      const Eigen::Vector2d away = Eigen::Vector2d(tile_x + kTile / 2.0, tile_y + kTile / 2.0) - middle;
      const bool is_sure = seen != nullptr || away.norm() * window.resolution_m < kNear_m;
      bool differs = false;
      for (int x = tile.first.x(); x <= tile.last.x(); ++x) {
        for (int y = tile.first.y(); y <= tile.last.y(); ++y) {
          for (int w = 0; w < grid_words; ++w) {
            const auto here = [&](const Sogm& what) {
              return word_of_column(what.column(0, x, y), words, w, -shift.z());
            };
            const auto at = static_cast<std::size_t>(w);
            stands_[at] = here(standing) & inside_[at];
            look_[at] = is_sure ? inside_[at] & ~stands_[at] & (seen != nullptr ? here(*seen) : ~std::uint64_t{0}) : 0;
          }
          differs = learn_column(x + shift.x(), y + shift.y()) || differs;
        }
      }
      if (!differs) continue;
      const Eigen::Vector2i corner = Eigen::Vector2i(tile_x, tile_y) + shift.head<2>();
      block(Columns{corner, corner.array() + kTile - 1}.grown(dilator_.radius_voxels(), grid));
      changed = true;
    }
  }
  if (changed) empty_ = std::ranges::all_of(occupied_.words(), [](std::uint64_t word) { return word == 0; });
  return changed;
}

bool GlobalMap::learn_column(int x, int y) {
  std::uint64_t* known = occupied_.column(0, x, y);
  const std::size_t n = stands_.size();
  for (std::size_t w = 0; w < n; ++w) gone_[w] = known[w] & look_[w];
  if (free_.num_frames > 0) {
    std::uint64_t* free = free_.column(0, x, y);
    for (std::size_t w = 0; w < n; ++w) {
      free[w] = (free[w] | look_[w]) & ~stands_[w];
      through_[w] = known[w] & ~free[w];
    }
    spread_along_z(through_, &gone_);
    for (std::size_t w = 0; w < n; ++w) through_[w] = inside_[w] & ~free[w];
    spread_along_z(through_, &stands_);
  }
  bool differs = false;
  for (std::size_t w = 0; w < n; ++w) {
    const std::uint64_t now = (known[w] & ~gone_[w]) | stands_[w];
    differs = differs || now != known[w];
    known[w] = now;
  }
  return differs;
}

bool GlobalMap::forget_seen() {
  if (occupied_.num_frames == 0) return false;
  const std::vector<std::uint64_t> before = occupied_.words();
  std::ranges::fill(occupied_.words_to_write(), 0);
  free_ = Sogm();
  if (file_) file_->copy_into(&occupied_);
  if (occupied_.words() == before) return false;
  block_all();
  return true;
}

// True: it was laid out anew.
bool GlobalMap::cover(const GridGeometry& window, const Eigen::Vector3d& goal) {
  const double resolution_m = window.resolution_m;
  if (occupied_.num_frames > 0 && occupied_.geometry.resolution_m != resolution_m) occupied_ = free_ = Sogm();
  const auto lattice = [&](const Eigen::Vector3d& place) { return lattice_voxel(place, resolution_m); };
  const int around = static_cast<int>(std::ceil(blocked_m_ / resolution_m)) + 1;
  const int slack = static_cast<int>(std::ceil(kSlack_m / resolution_m));
  const Box space = Box{lattice(space_min_), lattice(space_max_)}.grown(around);
  const Box near = box_of(window).cut(space), target = Box{lattice(goal), lattice(goal)}.grown(around).cut(space);
  if ((near.first.array() > near.last.array()).any()) return false;  // the robot is far outside the flight space
  const bool begins = occupied_.num_frames == 0;
  if (begins && tree_ != nullptr) file_.emplace(*tree_, static_map_, resolution_m, 0.5 * resolution_m);
  Box box = space.voxels() <= kSmall ? space : near.grown(slack).cut(space);
  if (!begins) box = box_of(occupied_.geometry).united(box);
  if (begins && file_ && file_->geometry().size.x() > 0)
    box = box.united(box_of(file_->geometry()).grown(slack).cut(space));
  const Box reach = box.grown(static_cast<int>(std::ceil(kGoal_m / resolution_m)));
  const bool has_target = (target.first.array() <= target.last.array()).all() && reach.holds(target) &&
                          box.united(target.grown(slack).cut(space)).voxels() <= kMaxVoxels;
  if (!begins && box_of(occupied_.geometry).holds(has_target ? near.united(target) : near)) return false;
  if (has_target) box = box.united(target.grown(slack).cut(space));
  if (box.voxels() > kMaxVoxels) box = near.grown(slack).cut(space);
  lay_out(box, resolution_m);
  return true;
}

// What was known stays, as far as there is room.
void GlobalMap::lay_out(const Box& box, double resolution_m) {
  const Sogm before = std::move(occupied_);
  occupied_ = Sogm();
  occupied_.reset(box.geometry(resolution_m), 1, Utime(), 1us);
  add_first_frame(before, &occupied_);
  if (free_.num_frames > 0) {
    const Sogm free = std::move(free_);
    free_ = Sogm();
    free_.reset(occupied_.geometry, 1, Utime(), 1us);
    add_first_frame(free, &free_);
  }
  if (file_) file_->copy_into(&occupied_);
  dilator_.set(occupied_.geometry, blocked_m_);
  blocked_.reset(occupied_.geometry, 1, Utime(), 1us);
  block_all();
}

void GlobalMap::block_all() {
  empty_ = std::ranges::all_of(occupied_.words(), [](std::uint64_t word) { return word == 0; });
  const Columns all = all_columns(occupied_.geometry);
  for (int x = 0; x <= all.last.x(); x += kStrip)
    block({{x, 0}, {std::min(x + kStrip - 1, all.last.x()), all.last.y()}});
}

// Works out where the centre may not be, in these columns.
void GlobalMap::block(const Columns& columns) {
  if (columns.empty()) return;
  const GridGeometry& grid = occupied_.geometry;
  const Layer source = layer_of(occupied_, 0);
  dilator_.dilate({&source, 1}, columns, blocked_.columns(0, columns), source.row);
  const auto words = static_cast<std::size_t>(grid.words_per_column());
  column_.assign(words, 0);  // inside the flight space
  for (int z = 0; z < grid.size.z(); ++z) {
    if (in_flight_space(2, z + grid.origin.z()))
      column_[static_cast<std::size_t>(z / 64)] |= std::uint64_t{1} << z % 64;
  }
  for (int x = columns.first.x(); x <= columns.last.x(); ++x) {
    for (int y = columns.first.y(); y <= columns.last.y(); ++y) {
      const bool inside = in_flight_space(0, x + grid.origin.x()) && in_flight_space(1, y + grid.origin.y());
      std::uint64_t* blocked = blocked_.column(0, x, y);
      for (std::size_t w = 0; w < words; ++w) blocked[w] |= inside ? ~column_[w] : ~std::uint64_t{0};
    }
  }
}

}  // namespace swarm
