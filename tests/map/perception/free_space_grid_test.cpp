// The grid of free space against plain numbers kept voxel by voxel, and its rays against the voxels that they cross.
// Long because the oracle stands beside its tests.
#include "map_daemon/perception/free_space_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using GridWord = std::uint64_t (FreeSpaceGrid::*)(int) const;

constexpr double kBinary_m = 0.125;  // voxels whose borders and centres are exact numbers
constexpr Duration kGridMemory = 2s;
constexpr int kGridEdge = FreeSpaceGrid::kEdge, kGridHeight = FreeSpaceGrid::kHeight;
const Eigen::Vector3i kGridSize(kGridEdge, kGridEdge, kGridHeight);

struct ByAxes {
  bool operator()(const Eigen::Vector3i& a, const Eigen::Vector3i& b) const {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  }
};
bool is_in_window(const Eigen::Vector3i& v) {
  return GridGeometry{.size = kGridSize}.contains(v);
}
// Of a voxel of the world.
Eigen::Vector3d middle_of(const Eigen::Vector3i& voxel) {
  return (voxel.cast<double>().array() + 0.5).matrix() * kBinary_m;
}
bool knows(const FreeSpaceGrid& grid, GridWord what, const Eigen::Vector3i& voxel) {
  const Eigen::Vector3i v = voxel - grid.geometry().origin;
  return is_in_window(v) && ((grid.*what)(grid.column_of(v.x(), v.y())) >> v.z() & 1) != 0;
}
std::vector<std::uint64_t> words_of(const FreeSpaceGrid& grid, GridWord what) {
  std::vector<std::uint64_t> words;
  for (int x = 0; x < kGridEdge; ++x)
    for (int y = 0; y < kGridEdge; ++y) words.push_back((grid.*what)(grid.column_of(x, y)));
  return words;
}

struct PlainVoxel {
  int certainty = 0, free_scans = 0;
  bool ever_free = false, occupied = false;
  int seen_in = 0, not_occupied_in = 0;  // newest stretch of time of which that is true
};

// The same in plain numbers, by the voxels of the world.
class PlainGrid {
 public:
  enum Sight { kFree, kSurface, kMovingSurface };

  void move_to(const Eigen::Vector3i& middle) {
    origin_ = middle - kGridSize / 2;
    std::erase_if(voxels, [this](const auto& entry) { return !is_in_window(entry.first - origin_); });
    std::erase_if(passed_, [this](const auto& voxel) { return !is_in_window(voxel - origin_); });
  }
  void see(const Eigen::Vector3i& voxel, Sight sight) {
    if (is_in_window(voxel - origin_)) sights_[sight].insert(voxel);
  }
  void finish(Utime utime, Doubt doubt) {
    pass_time(utime);
    passed_.insert(sights_[kFree].begin(), sights_[kFree].end());
    for (const Eigen::Vector3i& voxel : sights_[kFree]) {  // also beside surfaces
      const auto known = voxels.find(voxel);
      if (known == voxels.end() || sights_[kSurface].contains(voxel) || sights_[kMovingSurface].contains(voxel))
        continue;
      known->second.certainty = std::max(known->second.certainty - 1, 0);
    }
    for (const Sight sight : {kSurface, kMovingSurface})
      for (const Eigen::Vector3i& voxel : sights_[sight]) protect(voxel);
    for (const Eigen::Vector3i& voxel : sights_[kFree]) {
      PlainVoxel& known = look_at(voxel);
      known.ever_free |= ++known.free_scans >= 10;
    }
    for (const Eigen::Vector3i& voxel : sights_[kMovingSurface]) look_at(voxel).free_scans = 0;
    for (const Eigen::Vector3i& voxel : sights_[kSurface]) {
      if (sights_[kMovingSurface].contains(voxel)) continue;
      PlainVoxel& known = look_at(voxel);
      known.free_scans = 0;
      const bool is_alone = passed_.erase(voxel) > 0 || !beside_.contains(voxel);
      taken_at_once += known.certainty == 0 && doubt == Doubt::kAlone && !is_alone ? 1 : 0;
      known.occupied |= known.certainty > 0 || doubt == Doubt::kNowhere || (doubt == Doubt::kAlone && !is_alone);
      known.certainty = known.certainty > 0 ? 7 : 3;
    }
    for (auto& [voxel, known] : voxels) known.occupied &= known.certainty > 0;
    for (auto& seen : sights_) seen.clear();
    beside_.clear();
    note_what_is_not_occupied();
  }
  // It stood there, long before; of what is known that says nothing. Whether it stands now.
  bool recall(const Eigen::Vector3i& voxel) {
    const auto at = voxels.find(voxel);
    if (at != voxels.end() && (is_seen(at->second) || at->second.certainty > 0)) return false;
    PlainVoxel& known = voxels.try_emplace(voxel, PlainVoxel{.seen_in = seen_stretch_ - 3}).first->second;
    known.certainty = 1;
    known.occupied = true;
    known.not_occupied_in = lasting_stretch_ - 2;
    return true;
  }
  bool is_seen(const PlainVoxel& known) const { return known.seen_in >= seen_stretch_ - 2; }

  std::map<Eigen::Vector3i, PlainVoxel, ByAxes> voxels;
  int taken_at_once = 0;  // surfaces that were not doubted, where another grid would have

 private:
  // What is beside a surface across the border of the window is not freed either, which errs to the safe side.
  void protect(const Eigen::Vector3i& voxel) {
    for (int i = 0; i < 27; ++i) {
      Eigen::Vector3i beside = voxel - origin_ + Eigen::Vector3i(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1) + kGridSize;
      for (int axis = 0; axis < 3; ++axis) beside[axis] = beside[axis] % kGridSize[axis] + origin_[axis];
      sights_[kFree].erase(beside);
      if (i != 13) beside_.insert(beside);
    }
  }
  PlainVoxel& look_at(const Eigen::Vector3i& voxel) {
    PlainVoxel& known = voxels.try_emplace(voxel, PlainVoxel{.not_occupied_in = lasting_stretch_}).first->second;
    known.seen_in = seen_stretch_;
    return known;
  }
  static bool is_over(Utime* since, Duration stretch, Utime utime) {
    if (utime >= *since && utime < *since + stretch) return false;
    *since = utime;
    return true;
  }
  void note_what_is_not_occupied() {
    for (auto& [voxel, known] : voxels)
      if (known.certainty == 0) known.not_occupied_in = lasting_stretch_;
  }
  void pass_time(Utime utime) {
    const bool is_long = utime >= seen_since_ + 3 * (kGridMemory / 2);
    if (is_over(&seen_since_, kGridMemory / 2, utime)) seen_stretch_ += is_long ? 3 : 1;
    if (!is_over(&lasting_since_, 2s, utime)) return;
    for (auto& [voxel, known] : voxels) known.ever_free &= known.not_occupied_in >= lasting_stretch_ - 1;
    ++lasting_stretch_;
    note_what_is_not_occupied();
  }

  Eigen::Vector3i origin_ = Eigen::Vector3i::Zero();
  std::set<Eigen::Vector3i, ByAxes> sights_[3];
  std::set<Eigen::Vector3i, ByAxes> beside_;  // the neighbours of surfaces
  std::set<Eigen::Vector3i, ByAxes> passed_;  // since a ray met it
  int seen_stretch_ = 0, lasting_stretch_ = 0;
  Utime seen_since_{}, lasting_since_{};
};

// How many voxels are so.
template <class Is>
int expect_same(const FreeSpaceGrid& grid, GridWord what, const PlainGrid& plain, const Is& is) {
  std::vector<std::uint64_t> words = words_of(grid, what);
  int count = 0;
  for (const auto& [voxel, known] : plain.voxels) {
    const Eigen::Vector3i v = voxel - grid.geometry().origin;
    std::uint64_t& word = words[static_cast<std::size_t>(v.x() * kGridEdge + v.y())];
    EXPECT_EQ((word >> v.z() & 1) != 0, is(known)) << "voxel " << voxel.transpose();
    word &= ~(std::uint64_t{1} << v.z());
    count += is(known) ? 1 : 0;
  }
  EXPECT_EQ(std::ranges::count(words, 0u), std::ssize(words)) << "columns with voxels that nobody saw";
  return count;
}

// The same rays and surfaces scan after scan, most of them each time, as around a robot that flies on slowly.
class TwoGrids {
 public:
  explicit TwoGrids(unsigned seed) : rng_(seed) { move(true); }

  void move(bool jump) {
    if (jump) middle_ = random_voxel(3000, 300);
    if (uniform_int(rng_, 0, 3) == 0) middle_ = random_voxel(3, 3);
    if (uniform_int(rng_, 0, 99) < 2) middle_[uniform_int(rng_, 0, 2)] += uniform_int(rng_, -140, 140);
    grid_.move_to(middle_of(middle_));
    plain_.move_to(middle_);
    if (jump) draw_rays();
    if (jump || uniform_int(rng_, 0, 29) == 0) draw_surfaces();
  }
  void scan() {
    for (const auto& [begin, way] : rays_) {
      if (uniform_int(rng_, 0, 9) == 0) continue;
      grid_.see_free(middle_of(begin), middle_of(begin + way));
      const int length = way.cwiseAbs().maxCoeff();
      for (int i = 0; i <= length; ++i) plain_.see(begin + i * way / std::max(length, 1), PlainGrid::kFree);
    }
    for (const auto& [voxel, sight] : surfaces_) {
      if (uniform_int(rng_, 0, 5) == 0) continue;
      const Eigen::Vector3d place = middle_of(voxel) + in_cube(rng_, 0.49 * kBinary_m);
      grid_.see_surface(place);
      if (sight == PlainGrid::kMovingSurface) grid_.mark_moving(place);
      plain_.see(voxel, sight);
    }
    now_ += uniform_int(rng_, 0, 99) == 0 ? Duration(-5s) : uniform_duration(rng_, 20ms, 400ms);
    const auto doubt = static_cast<Doubt>(uniform_int(rng_, 0, 2));
    grid_.finish(now_, doubt);
    plain_.finish(now_, doubt);
  }
  // In columns that rays meet, and in others.
  void recall() {
    for (int i = 0; i < 12; ++i) {
      const auto& [begin, way] = rays_[static_cast<std::size_t>(uniform_int(rng_, 0, 24))];
      const GridGeometry& window = grid_.geometry();
      const Eigen::Vector3i at = (i % 2 == 0 ? begin + way / 2 : random_voxel(63, 30)) - window.origin;
      if (!is_in_window({at.x(), at.y(), 0})) continue;
      std::uint64_t standing = 0;
      for (int k = 0; k < 5; ++k) {
        const int z =
            i % 2 == 0 && k < 2 ? std::clamp(at.z() + k, 0, kGridHeight - 1) : uniform_int(rng_, 0, kGridHeight - 1);
        if ((standing >> z & 1) != 0) continue;
        standing |= std::uint64_t{1} << z;
        (plain_.recall(window.origin + Eigen::Vector3i(at.x(), at.y(), z)) ? recalled : known_better) += 1;
      }
      grid_.recall(grid_.column_of(at.x(), at.y()), standing);
    }
  }
  void compare() {
    occupied += expect_same(grid_, &FreeSpaceGrid::occupied, plain_, [](auto& known) { return known.occupied; });
    ever_free += expect_same(grid_, &FreeSpaceGrid::ever_free, plain_, [](auto& known) { return known.ever_free; });
    const auto is_seen = [this](auto& known) { return plain_.is_seen(known); };
    forgotten += static_cast<int>(plain_.voxels.size()) - expect_same(grid_, &FreeSpaceGrid::seen, plain_, is_seen);
    taken_at_once = plain_.taken_at_once;
    for (const auto& [voxel, known] : plain_.voxels) both += known.occupied && known.ever_free ? 1 : 0;
  }

  int occupied = 0, ever_free = 0, both = 0, forgotten = 0, recalled = 0, known_better = 0;  // voxels, of all scans
  int taken_at_once = 0;

 private:
  Eigen::Vector3i random_voxel(int xy, int z) {
    const auto off = [this](int most) { return uniform_int(rng_, -most, most); };
    return middle_ + Eigen::Vector3i(off(xy), off(xy), off(z));
  }
  Eigen::Vector3i random_voxel_beside(const Eigen::Vector3i& voxel) {
    const auto step = [this] { return uniform_int(rng_, -1, 1); };
    return voxel + Eigen::Vector3i(step(), step(), step());
  }
  void draw_rays() {  // some leave the window
    rays_.clear();
    for (int i = 0; i < 25; ++i) {
      Eigen::Vector3i way = Eigen::Vector3i::Zero();
      way[uniform_int(rng_, 0, 2)] = uniform_int(rng_, -30, 30) * (i == 0 ? 10 : 1);
      rays_.emplace_back(random_voxel(70, 36), way);
    }
  }
  void draw_surfaces() {  // some on the way of rays, sometimes none
    surfaces_.clear();
    for (int i = 0; i < uniform_int(rng_, 0, 40); ++i) {
      const auto& [begin, way] = rays_[static_cast<std::size_t>(uniform_int(rng_, 0, 24))];
      surfaces_.emplace_back(i % 2 == 0 ? begin + way / 3 : random_voxel(70, 36),
                             i % 3 == 0 ? PlainGrid::kMovingSurface : PlainGrid::kSurface);
      if (i % 2 == 1) surfaces_.emplace_back(random_voxel_beside(surfaces_.back().first), PlainGrid::kSurface);
    }
  }

  Rng rng_;
  FreeSpaceGrid grid_{kBinary_m, kGridMemory};
  PlainGrid plain_;
  Eigen::Vector3i middle_ = Eigen::Vector3i::Zero();
  std::vector<std::pair<Eigen::Vector3i, Eigen::Vector3i>> rays_;  // where they begin, and how far they go
  std::vector<std::pair<Eigen::Vector3i, PlainGrid::Sight>> surfaces_;
  Utime now_ = kStart;
};

TEST(FreeSpaceGrid, KnowsOfEachVoxelWhatPlainNumbersSay) {
  int occupied = 0, ever_free = 0, both = 0, forgotten = 0, recalled = 0, known_better = 0, taken_at_once = 0;
  for (unsigned seed = 0; seed < 16; ++seed) {
    TwoGrids grids(seed);
    for (int k = 0; k < 150 && !testing::Test::HasFailure(); ++k) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << " scan " << k);
      grids.move(k % 70 == 69);
      grids.scan();
      if (seed % 2 == 1 && k % 5 == 0) grids.recall();
      grids.compare();
    }
    occupied += grids.occupied, ever_free += grids.ever_free, both += grids.both, forgotten += grids.forgotten;
    recalled += grids.recalled, known_better += grids.known_better, taken_at_once += grids.taken_at_once;
  }
  for (const int count : {occupied, ever_free, both, forgotten, recalled, known_better, taken_at_once})
    EXPECT_GT(count, 100);
}

// Of the way from `from` to `to`, so much is in the box; below 0: it passes beside it.
double length_inside(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Eigen::Array3d& low,
                     const Eigen::Array3d& high) {
  const Eigen::Array3d way = (to - from).array() + 1e-9;  // never along a border
  const Eigen::Array3d a = (low - from.array()) / way, b = (high - from.array()) / way;
  return (std::min(a.max(b).minCoeff(), 1.0) - std::max(a.min(b).maxCoeff(), 0.0)) * (to - from).norm();
}

// In voxels of the window: what is freed lies on the ray, and what it passes over a good part of a voxel's edge is
// freed, unless the ray is short.
int expect_passed(const FreeSpaceGrid& grid, const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  constexpr double kErr = 0.02;  // of numbers in fixed point
  const std::vector<std::uint64_t> words = words_of(grid, &FreeSpaceGrid::free);
  const bool is_short = length_inside(from, to, Eigen::Array3d::Zero(), kGridSize.cast<double>().array()) < 3.0;
  int freed = 0;
  for (int column = 0; column < kGridEdge * kGridEdge; ++column) {
    const int row = column / kGridEdge;
    const Eigen::Array3d low(row, column % kGridEdge, 0.0), top(1.0, 1.0, kGridHeight);
    const std::uint64_t word = words[static_cast<std::size_t>(column)];
    if (word == 0 && length_inside(from, to, low, low + top) <= 0.0) continue;
    for (int z = 0; z < kGridHeight; ++z) {
      const bool is_freed = (word >> z & 1) != 0;
      const Eigen::Array3d corner = low + Eigen::Array3d(0, 0, z);
      freed += is_freed ? 1 : 0;
      EXPECT_TRUE(!is_freed || length_inside(from, to, corner - kErr, corner + 1.0 + kErr) >= 0.0)
          << corner.transpose();
      EXPECT_TRUE(is_freed || is_short || length_inside(from, to, corner, corner + 1.0) < 0.6 + kErr)
          << corner.transpose();
    }
  }
  return freed;
}

TEST(FreeSpaceGrid, RaysFreeWhatTheyPass) {
  Rng rng(3);
  int most = 0, none = 0;
  FreeSpaceGrid grid(0.1, kGridMemory);
  for (int i = 0; i < 600 && !testing::Test::HasFailure(); ++i) {
    grid.finish(kStart, Doubt::kAlone);
    const Eigen::Vector3d middle = in_cube(rng, 50.0);
    grid.move_to(middle);
    const double reach_m = i % 2 == 0 ? 6.0 : 14.0;
    const Eigen::Vector3d reach(reach_m, reach_m, reach_m / 2), from = in_box(rng, middle - reach, middle + reach);
    Eigen::Vector3d to = in_box(rng, middle - reach, middle + reach);
    if (i % 3 == 0) to[i / 3 % 3] = from[i / 3 % 3], to[i / 9 % 3] = from[i / 9 % 3];
    if (i % 10 == 1) to = from + in_cube(rng, 0.2);
    SCOPED_TRACE(testing::Message() << "ray " << i << " from " << from.transpose() << " to " << to.transpose());
    grid.see_free(from, to);
    const Eigen::Vector3d corner = grid.geometry().origin.cast<double>();
    const int freed = expect_passed(grid, from / 0.1 - corner, to / 0.1 - corner);
    most = std::max(most, freed);
    none += freed == 0 ? 1 : 0;
  }
  EXPECT_GT(most, 120);
  EXPECT_GT(none, 20);
}

TEST(FreeSpaceGrid, SurfacesKeepTheirNeighboursFromBeingFreed) {
  FreeSpaceGrid grid(kBinary_m, kGridMemory);
  grid.move_to({0, 0, 0});
  const Eigen::Vector3i surface(-1, 0, 0);  // where numbers of columns, and bits of words, begin again
  for (int k = 0; k < 10; ++k) {
    for (int i = 0; i < 49; ++i) {
      const Eigen::Vector3i low = surface + Eigen::Vector3i(i / 7 - 3, i % 7 - 3, -3);
      grid.see_free(middle_of(low), middle_of(low + Eigen::Vector3i(0, 0, 6)));
    }
    grid.see_surface(middle_of(surface));
    grid.finish(kStart + k * 100ms, Doubt::kAlone);
  }
  for (int i = 0; i < 343; ++i) {
    const Eigen::Vector3i off(i / 49 - 3, i / 7 % 7 - 3, i % 7 - 3);
    const bool is_near = off.cwiseAbs().maxCoeff() <= 1;
    EXPECT_EQ(knows(grid, &FreeSpaceGrid::ever_free, surface + off), !is_near) << off.transpose();
    EXPECT_EQ(knows(grid, &FreeSpaceGrid::seen, surface + off), !is_near || off.isZero()) << off.transpose();
    EXPECT_EQ(knows(grid, &FreeSpaceGrid::occupied, surface + off), off.isZero()) << off.transpose();
  }
}

TEST(FreeSpaceGrid, NamesColumnsWithSurfacesOnce) {
  FreeSpaceGrid grid(kBinary_m, kGridMemory);
  grid.move_to({-4, 9, 2});
  for (const Eigen::Vector3i& voxel : {Eigen::Vector3i(3, 8, 5), {3, 8, 63}, {120, 0, 0}, {3, 8, 5}})
    grid.see_surface(grid.geometry().center_of(voxel));
  ASSERT_EQ(grid.surface_columns(), (std::vector<int>{grid.column_of(3, 8), grid.column_of(120, 0)}));
  EXPECT_EQ(grid.place_of(grid.surface_columns()[0]), Eigen::Vector2i(3, 8));
  EXPECT_EQ(grid.surfaces(grid.column_of(3, 8)), std::uint64_t{1} << 63 | 1u << 5);
  grid.finish(kStart, Doubt::kAlone);
  EXPECT_TRUE(grid.surface_columns().empty());
  EXPECT_EQ(grid.surfaces(grid.column_of(3, 8)), 0u);
}

// A grid of which one voxel is looked at, ten times a second.
class WatchedVoxel {
 public:
  WatchedVoxel() { grid_.move_to({0, 0, 0}); }
  enum Sight { kNothing, kFree, kSurface, kMoving };
  void see(Sight sight, int scans = 1) {
    for (; scans > 0; --scans) {
      if (sight == kFree) grid_.see_free(place_, place_);
      if (sight >= kSurface) grid_.see_surface(place_);
      if (sight == kMoving) grid_.mark_moving(place_);
      grid_.finish(now += 100ms, Doubt::kAlone);
    }
  }
  bool is(GridWord what) const { return knows(grid_, what, {3, -5, 7}); }

  Utime now = kStart;

 private:
  FreeSpaceGrid grid_{kBinary_m, kGridMemory};
  Eigen::Vector3d place_ = middle_of({3, -5, 7});
};

TEST(FreeSpaceGrid, IsFreeAfterTenScansOneAfterTheOther) {
  WatchedVoxel voxel;
  voxel.see(voxel.kFree, 9);
  voxel.see(voxel.kSurface);
  voxel.see(voxel.kFree, 9);
  EXPECT_FALSE(voxel.is(&FreeSpaceGrid::ever_free));
  voxel.see(voxel.kNothing, 5);  // breaks nothing
  voxel.see(voxel.kFree);
  EXPECT_TRUE(voxel.is(&FreeSpaceGrid::ever_free));
}

TEST(FreeSpaceGrid, WhatWasSeenOftenTakesLongerToBeGone) {
  for (const int surfaces : {2, 20}) {
    WatchedVoxel voxel;
    voxel.see(voxel.kSurface, surfaces);
    voxel.see(voxel.kFree, 6);
    EXPECT_TRUE(voxel.is(&FreeSpaceGrid::occupied)) << surfaces;
    voxel.see(voxel.kFree);
    EXPECT_FALSE(voxel.is(&FreeSpaceGrid::occupied)) << surfaces;
  }
}

// Within three scans that pass it is met again, or it was nothing.
TEST(FreeSpaceGrid, WhatIsMetOnceIsNotOccupied) {
  for (const int frees : {0, 2, 3}) {
    WatchedVoxel voxel;
    voxel.see(voxel.kSurface);
    EXPECT_FALSE(voxel.is(&FreeSpaceGrid::occupied)) << frees;
    voxel.see(voxel.kFree, frees);
    voxel.see(voxel.kSurface);
    EXPECT_EQ(voxel.is(&FreeSpaceGrid::occupied), frees < 3) << frees;
  }
}

// Alone it is doubted, and where a ray passed since the last one that met something.
TEST(FreeSpaceGrid, WhatIsMetWithItsNeighbourStandsWhereNothingPassed) {
  for (int i = 0; i < 125; ++i) {
    const Eigen::Vector3i voxel(3, -5, 7), off(i / 25 - 2, i / 5 % 5 - 2, i % 5 - 2);
    const bool is_beside = off.cwiseAbs().maxCoeff() == 1;
    SCOPED_TRACE(testing::Message() << "neighbour at " << off.transpose());
    FreeSpaceGrid grid(kBinary_m, kGridMemory);
    grid.move_to({0, 0, 0});
    const auto stands = [&] { return knows(grid, &FreeSpaceGrid::occupied, voxel); };
    const auto meet = [&] {
      grid.see_surface(middle_of(voxel));
      grid.see_surface(middle_of(voxel + off));
      grid.finish(kStart, Doubt::kAlone);
    };
    meet();
    EXPECT_EQ(stands(), is_beside);
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(stands(), is_beside);
      grid.see_free(middle_of(voxel), middle_of(voxel));
      grid.finish(kStart, Doubt::kAlone);
    }
    EXPECT_FALSE(stands());
    meet();
    EXPECT_FALSE(stands());
  }
}

// What was not doubted stands, also where a scan that doubts did not meet it since.
TEST(FreeSpaceGrid, WhoDoesNotDoubtTakesEachRayForASurface) {
  for (const Doubt doubt : {Doubt::kNowhere, Doubt::kAlone, Doubt::kEverywhere}) {
    const bool is_taken = doubt == Doubt::kNowhere;
    FreeSpaceGrid grid(kBinary_m, kGridMemory);
    grid.move_to({0, 0, 0});
    grid.see_free(middle_of({5, 0, 0}), middle_of({5, 0, 1}));
    grid.finish(kStart - 100ms, doubt);
    grid.see_surface(middle_of({5, 0, 0}));
    grid.finish(kStart, doubt);
    EXPECT_EQ(knows(grid, &FreeSpaceGrid::occupied, {5, 0, 0}), is_taken);
    grid.see_surface(middle_of({5, 0, 1}));
    grid.finish(kStart + 100ms, Doubt::kAlone);
    EXPECT_EQ(knows(grid, &FreeSpaceGrid::occupied, {5, 0, 0}), is_taken);
    EXPECT_FALSE(knows(grid, &FreeSpaceGrid::occupied, {5, 0, 1}));
  }
}

// Rays that pass it beside a surface make it no wall that never goes, although it is not free for certain.
TEST(FreeSpaceGrid, WallsDoNotGrowBySingleErrors) {
  FreeSpaceGrid grid(kBinary_m, kGridMemory);
  grid.move_to({0, 0, 0});
  const Eigen::Vector3i wall(5, 0, 0), beside(4, 0, 0);
  for (int k = 0; k < 20; ++k) {
    grid.see_free(middle_of({0, 0, 0}), middle_of(beside));
    grid.see_surface(middle_of(wall));
    if (k < 2) grid.see_surface(middle_of(beside));
    grid.finish(kStart + k * 100ms, Doubt::kAlone);
    EXPECT_EQ(knows(grid, &FreeSpaceGrid::occupied, beside), k >= 1 && k < 8) << k;
    EXPECT_TRUE(knows(grid, &FreeSpaceGrid::occupied, wall)) << k;
  }
  EXPECT_FALSE(knows(grid, &FreeSpaceGrid::ever_free, beside));
}

// Many rays pass just over a table for each that meets it.
TEST(FreeSpaceGrid, RaysOverWhatIsFlatDoNotEraseIt) {
  // So high above the voxel's floor they pass: over what fills most of it, or through the middle.
  for (const auto& [height, are_sparse] : {std::pair(0.75, true), std::pair(0.75, false), std::pair(0.5, true)}) {
    const bool is_kept = height == 0.75 && are_sparse;
    FreeSpaceGrid grid(kBinary_m, kGridMemory);
    grid.move_to({0, 0, 0});
    const Eigen::Vector3i table(5, 0, 0);
    const Eigen::Vector3d from = middle_of({1, 0, 0}) + Eigen::Vector3d(0, 0, (height - 0.5) * kBinary_m);
    const Eigen::Vector3d way(8 * kBinary_m, 0, 0);
    for (int k = 0; k < 20; ++k) {
      if (k % 5 == 0) grid.see_surface(middle_of(table));
      grid.see_free(from, from + way, are_sparse);
      grid.finish(kStart + k * 100ms, Doubt::kAlone);
      EXPECT_EQ(knows(grid, &FreeSpaceGrid::occupied, table), is_kept && k >= 5) << k;
      EXPECT_TRUE(knows(grid, &FreeSpaceGrid::seen, table));
    }
  }
}

TEST(FreeSpaceGrid, WhatMovesIsNotKeptAsOccupied) {
  WatchedVoxel voxel;
  voxel.see(voxel.kFree, 10);
  for (int i = 0; i < 100; ++i) {
    voxel.see(voxel.kMoving);
    EXPECT_FALSE(voxel.is(&FreeSpaceGrid::occupied));
    EXPECT_TRUE(voxel.is(&FreeSpaceGrid::ever_free));
    EXPECT_TRUE(voxel.is(&FreeSpaceGrid::seen));
  }
  voxel.see(voxel.kSurface, 2);  // that it moves was of one scan
  EXPECT_TRUE(voxel.is(&FreeSpaceGrid::occupied));
}

// It lasts after two seconds at the earliest and four at the latest, and was never free after two more, whenever in its
// stretches of time the grid sees it first.
TEST(FreeSpaceGrid, WhatStaysLastsAndWasNeverFree) {
  for (int phase = 0; phase < 25; ++phase) {
    SCOPED_TRACE(phase);
    WatchedVoxel voxel;
    voxel.see(voxel.kFree, 10 + phase);
    voxel.see(voxel.kSurface, 20);
    EXPECT_FALSE(voxel.is(&FreeSpaceGrid::lasting));
    voxel.see(voxel.kSurface, 20);
    EXPECT_TRUE(voxel.is(&FreeSpaceGrid::ever_free));
    voxel.see(voxel.kSurface, 1);
    EXPECT_TRUE(voxel.is(&FreeSpaceGrid::lasting));
    voxel.see(voxel.kSurface, 20);
    EXPECT_FALSE(voxel.is(&FreeSpaceGrid::ever_free));
    voxel.see(voxel.kFree, 7);
    EXPECT_FALSE(voxel.is(&FreeSpaceGrid::lasting));
  }
}

TEST(FreeSpaceGrid, ForgetsAfterItsMemory) {
  for (int phase = 0; phase < 25; ++phase) {
    WatchedVoxel voxel;
    voxel.see(voxel.kFree, 1 + phase);
    voxel.see(voxel.kNothing, 19);
    EXPECT_TRUE(voxel.is(&FreeSpaceGrid::seen)) << phase;
    voxel.see(voxel.kNothing, 11);
    EXPECT_FALSE(voxel.is(&FreeSpaceGrid::seen)) << phase;
  }
}

// A sensor that was silent for long: what it saw before is as old as that.
TEST(FreeSpaceGrid, ForgetsWhileThereAreNoScans) {
  WatchedVoxel voxel;
  voxel.see(voxel.kFree, 5);
  voxel.now += 10 * kGridMemory;
  voxel.see(voxel.kNothing);
  EXPECT_FALSE(voxel.is(&FreeSpaceGrid::seen));
}

// All was free, then all is occupied, and after a move that is known of what is still inside and of nothing else.
TEST(FreeSpaceGrid, WhatEntersTheWindowIsUnknown) {
  FreeSpaceGrid full(kBinary_m, kGridMemory);
  const Eigen::Vector3i middle(-131, 75, -9);
  full.move_to(middle_of(middle));
  for (int k = 0; k < 12; ++k) {
    for (int i = 0; i < kGridEdge * kGridEdge; ++i) {
      const Eigen::Vector3d low = full.geometry().center_of({i / kGridEdge, i % kGridEdge, 0});
      if (k < 10) full.see_free(low - Eigen::Vector3d(0, 0, 1), low + Eigen::Vector3d(0, 0, 20));
      for (int z = 0; k >= 10 && z < kGridHeight; ++z) full.see_surface(low + z * kBinary_m * Eigen::Vector3d::UnitZ());
    }
    full.finish(kStart + k * 10ms, Doubt::kAlone);
  }
  const int moves[][3] = {{0, 0, 0},   {3, 0, 0},   {-3, 0, 0},   {0, 5, 0},      {0, -1, 0},
                          {0, 0, 7},   {0, 0, -7},  {2, -3, 4},   {-127, 127, 0}, {0, 0, 63},
                          {0, 0, -63}, {128, 0, 0}, {0, -128, 1}, {0, 0, 64},     {1, 0, -64}};
  for (const auto& move : moves) {
    const Eigen::Vector3i by(move);
    FreeSpaceGrid grid = full;
    grid.move_to(middle_of(middle + by));
    std::vector<std::uint64_t> expected(kGridEdge * kGridEdge);
    for (int i = 0; i < kGridEdge * kGridEdge; ++i)
      for (int z = 0; z < kGridHeight; ++z)
        if (is_in_window(Eigen::Vector3i(i / kGridEdge, i % kGridEdge, z) + by))
          expected[static_cast<std::size_t>(i)] |= std::uint64_t{1} << z;
    for (const GridWord what : {&FreeSpaceGrid::occupied, &FreeSpaceGrid::ever_free, &FreeSpaceGrid::seen})
      EXPECT_TRUE(words_of(grid, what) == expected) << "moved by " << by.transpose();
  }
}

}  // namespace
}  // namespace swarm
