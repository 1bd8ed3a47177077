// The layers against their definition, wherever and in whatever order they are looked at.
#include "planner_daemon/space/configuration_space.h"

#include <gtest/gtest.h>

#include <optional>
#include <vector>

#include "planner_daemon/space/first_touch.h"
#include "tests/support/random_map.h"
#include "tests/support/random_reachable_set.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

// Adds what a peer sweeps, everywhere.
void draw(const Motion& motion, double radius_m, Sogm* sogm) {
  const std::vector<Columns> everywhere(static_cast<std::size_t>(sogm->num_frames), all_columns(sogm->geometry));
  SweptVolumes volumes;
  volumes.lay_out(*sogm);
  volumes.add(motion, radius_m, to_duration(ConfigurationSpaceOptions().clock_error_s), everywhere);
  for (int frame = 0; frame < sogm->num_frames; ++frame) {
    std::vector<Layer> layers;
    volumes.append_layers(frame, all_columns(sogm->geometry), &layers);
    for (const Layer& layer : layers) {
      for_each_column(sogm->geometry, [&](int x, int y) {
        if (!holds(layer.columns, x, y)) return;
        const Eigen::Vector2i at = Eigen::Vector2i(x, y) - layer.columns.first;
        const int words = sogm->geometry.words_per_column();
        for (int w = 0; w < words; ++w)
          sogm->column(frame, x, y)[w] |=
              layer.words[static_cast<std::size_t>(at.x()) * layer.row + at.y() * words + w];
      });
    }
  }
}

// Occupied voxels and those of the peers.
Sogm with_peers(const Sogm& sogm, const std::vector<Peer>& peers) {
  Sogm all = sogm;
  for (const Peer& peer : peers) {
    const double radius_m = peer.radius_m + 0.5 * sogm.geometry.resolution_m;
    draw(peer.motion, radius_m, &all);
    if (!peer.pending.empty()) draw({peer.motion.committed, peer.pending}, radius_m, &all);
  }
  return all;
}

class ConfigurationSpaceTest : public testing::Test {
 protected:
  // What the layers are by definition, in the whole window.
  void define(const Sogm& sogm, const std::vector<Peer>& peers, const ConfigurationSpaceOptions& options) {
    const Sogm all = with_peers(sogm, peers);
    Sogm lately = all;
    const int back = static_cast<int>(std::lround(options.recently_occupied_s / to_seconds(all.frame_duration)));
    for (int frame = 0; frame < all.num_frames; ++frame) {
      for (int before = std::max(0, frame - back); before < frame; ++before) {
        for (int i = 0; i < all.geometry.words_per_frame(); ++i)
          lately.column(frame, 0, 0)[i] |= all.column(before, 0, 0)[i];
      }
    }
    dilate(all, options.radius_m + options.clearance_m, &blocked);
    for (const Peer& peer : peers) {
      if (peer.silent)
        draw(peer.motion, peer.radius_m + 0.5 * sogm.geometry.resolution_m + options.silent_peer_margin_m, &lately);
    }
    dilate(lately, options.radius_m + options.clearance_m, &recently_occupied);
    dilate(recently_occupied, options.inflation_m, &inflation);
    dilate(all, options.radius_m + options.emergency_clearance_m, &emergency);
    dilate(all, options.radius_m - options.collision_depth_m, &collision);
  }
  static std::uint64_t different(const Sogm& a, const Sogm& b, int frame, int x, int y) {
    std::uint64_t bits = 0;
    for (int w = 0; w < a.geometry.words_per_column(); ++w) bits |= a.column(frame, x, y)[w] ^ b.column(frame, x, y)[w];
    return bits;
  }
  // Of a voxel in blocked space.
  Severity severity(int frame, const Vector3i& voxel) const {
    if (collision.occupied(frame, voxel)) return Severity::kCollision;
    return emergency.occupied(frame, voxel) ? Severity::kEmergency : Severity::kBlocked;
  }
  Sogm blocked, recently_occupied, inflation, emergency, collision;
};

TEST_F(ConfigurationSpaceTest, EqualTheirDefinitionWhereLookedAt) {
  Rng rng(1);
  ConfigurationSpaceOptions options;
  options.silent_peer_margin_m = 0.3;
  ConfigurationSpace space(options);  // one for all: what is left of earlier maps must not show
  int compared = 0, severities = 0, set = 0;
  int clears[3] = {};  // always, from some frame on, never
  for (int trial = 0; trial < 40; ++trial) {
    const Vector3d size_m = trial / 10 == 1 ? Vector3d(3, 3.5, 7) : Vector3d(5, 4.3, 2);
    const Sogm sogm = random_map(rng, trial % 7, size_m, 8, kStart, 100ms);
    std::vector<Peer> peers(static_cast<std::size_t>(trial % 3));
    for (Peer& peer : peers) {
      peer.motion = random_motion(rng, kStart - 500ms, 2.0);
      peer.silent = trial % 5 == 0;
      if (trial % 2 == 0) {
        const Utime leave = kStart + 150ms;
        peer.pending = random_trajectory(rng, 2, leave, peer.motion.committed.at(leave), 2.0);
      }
    }
    // Far enough to come everywhere: then peers count in the whole window.
    const ReachableSet reach{{0, 0, 0}, kStart, 20.0, 2.0};
    space.compose(sogm, peers, reach);
    define(sogm, peers, options);
    SCOPED_TRACE(testing::Message() << "trial " << trial);
    for (int look = 0; look < 30; ++look) {
      const int frame = uniform_int(rng, 0, 7), last = std::min(7, frame + uniform_int(rng, 0, 2));
      Columns columns;
      for (int axis = 0; axis < 2; ++axis) {
        columns.first[axis] = uniform_int(rng, -5, sogm.geometry.size[axis] + 2);
        columns.last[axis] = columns.first[axis] + uniform_int(rng, 0, 15);
      }
      const bool all = look % 3 != 0;
      const Sogm& found = all ? space.layers(frame, last, columns).blocked : space.blocked(frame, last, columns);
      const ConfigurationSpace::Layers layers = space.layers(0, -1, {});
      for (int f = frame; f <= last; ++f) {
        for_each_column(sogm.geometry, [&](int x, int y) {
          if (!holds(columns, x, y)) return;
          ++compared;
          set += blocked.column(f, x, y)[0] != 0;
          EXPECT_EQ(different(found, blocked, f, x, y), 0u) << "blocked " << f << ": " << x << ' ' << y;
          if (all) {
            EXPECT_EQ(different(layers.recently_occupied, recently_occupied, f, x, y), 0u)
                << "recently occupied " << f << ": " << x << ' ' << y;
            EXPECT_EQ(different(layers.inflation, inflation, f, x, y), 0u)
                << "inflation " << f << ": " << x << ' ' << y;
          }
          if ((x + y + f) % 7 != 0) return;
          for (int z = 0; z < sogm.geometry.size.z(); ++z) {
            if (!blocked.occupied(f, {x, y, z})) continue;
            ++severities;
            const auto word = static_cast<std::size_t>(found.column(f, x, y) + (z >> 6) - found.words().data());
            EXPECT_EQ(space.severity(word, std::uint64_t{1} << (z & 63)), severity(f, {x, y, z}))
                << f << ": " << x << ' ' << y << ' ' << z;
          }
        });
        ASSERT_FALSE(HasFailure());
      }
    }
    for (int look = 0; look < 300; ++look) {
      const Vector3d position = in_box(rng, -0.5 * size_m, 0.5 * size_m);
      const Vector3i voxel = blocked.geometry.voxel_of(position);
      const int last = uniform_int(rng, 5, 7);
      int clear_from = last + 1;
      while (clear_from > 0 && !recently_occupied.occupied(clear_from - 1, voxel)) --clear_from;
      ASSERT_EQ(space.clear_from(position, last), clear_from);
      ++clears[clear_from == 0 ? 0 : clear_from <= last ? 1 : 2];
    }
    for (int look = 0; look < 50; ++look) {
      const Vector3d position = in_box(rng, -0.6 * size_m, 0.6 * size_m);
      const Utime utime = kStart + uniform_duration(rng, -200ms, 1200ms);
      const int frame = blocked.frame_at(utime);
      const Vector3i voxel = blocked.geometry.voxel_of(position);
      const bool is_blocked = blocked.occupied(frame, voxel);
      EXPECT_EQ(space.blocked_at(position, frame), is_blocked);
      EXPECT_EQ(space.recently_occupied_at(position, frame), recently_occupied.occupied(frame, voxel));
      const std::optional<Severity> found = space.severity_at(position, frame);
      EXPECT_EQ(found.has_value(), is_blocked);
      if (found) {
        EXPECT_EQ(*found, severity(frame, voxel));
      }
    }
  }
  EXPECT_GT(compared, 50'000);
  EXPECT_GT(severities, 20'000);
  EXPECT_GT(set, compared / 20);
  for (const int count : clears) EXPECT_GT(count, 30);
}

// A peer may be left out only where the robot does not come in time.
TEST_F(ConfigurationSpaceTest, PeersCountWhereTheRobotComes) {
  Rng rng(2);
  ConfigurationSpace space({});
  int near_peers = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const Sogm sogm = empty_map({6, 6, 2}, 0.1, 10, kStart, 100ms);
    std::vector<Peer> peers(1);
    peers[0].motion = random_motion(rng, kStart - 500ms, 2.0);
    const ReachableSet reach = random_reachable_set(rng, sogm);
    space.compose(sogm, peers, reach);
    define(sogm, peers, {});
    for (int frame = 0; frame < 10; ++frame) {
      const Columns columns = reachable_columns(sogm, frame, reach);
      if (columns.empty()) continue;
      const ConfigurationSpace::Layers layers = space.layers(frame, frame, columns);
      for_each_column(sogm.geometry, [&](int x, int y) {
        if (!holds(columns, x, y)) return;
        EXPECT_EQ(different(layers.blocked, blocked, frame, x, y), 0u) << "frame " << frame << ": " << x << ' ' << y;
        EXPECT_EQ(different(layers.inflation, inflation, frame, x, y), 0u)
            << "frame " << frame << ": " << x << ' ' << y;
        near_peers += inflation.column(frame, x, y)[0] != 0;
      });
      ASSERT_FALSE(HasFailure());
    }
  }
  EXPECT_GT(near_peers, 1000);
}

TEST_F(ConfigurationSpaceTest, StandingIsWhatIsOccupiedInAllFramesAndPeersThatHover) {
  ConfigurationSpace space({});
  Sogm sogm = empty_map({4, 4, 2}, 0.1, 6, kStart, 100ms);
  mark_box(&sogm, {1, 1, -9}, {1.3, 1.3, 9});
  mark_box(&sogm, {-1, 1, -9}, {-0.7, 1.3, 9}, 0, 4);
  mark_box(&sogm, {-1, -1, -9}, {-0.7, -0.7, 9}, 0, 2);
  mark_box(&sogm, {-1, -1, -9}, {-0.7, -0.7, 9}, 4, 5);
  std::vector<Peer> peers(2);
  peers[0].motion.committed = Trajectory::hover(1, kStart - 1s, {1, -1, 0});
  Rng rng(3);
  peers[1].motion.committed = random_trajectory(rng, 1, kStart - 100ms, MotionState{}, 1.0);  // still under way
  space.compose(sogm, peers, {{0, 0, 0}, kStart, 2.0, 2.0});
  const Occupancy standing = space.compose_standing(peers);
  Sogm occupied = *standing.sogm;
  std::vector<Layer> layers;
  standing.append_layers(0, all_columns(sogm.geometry), &layers);
  ASSERT_EQ(layers.size(), 2u);  // the map and one peer
  EXPECT_TRUE(holds(layers[1].columns, 30, 10));
  for_each_column(sogm.geometry, [&](int x, int y) {
    const Vector3d center = sogm.geometry.center_of({x, y, 10});
    const bool stands = center.x() > 1 && center.x() < 1.3 && center.y() > 1 && center.y() < 1.3;
    EXPECT_EQ(occupied.occupied(0, {x, y, 10}), stands) << x << ' ' << y;
  });
}

// What is occupied only because it was not seen keeps the robot off, but it may fly there rather than into what stands.
TEST_F(ConfigurationSpaceTest, WhatWasNotSeenIsNotKnownToStand) {
  ConfigurationSpace space({});
  Sogm sogm = empty_map({4, 4, 2}, 0.1, 6, kStart, 100ms);
  mark_box(&sogm, {1, 1, -9}, {1.3, 1.3, 9});
  mark_box(&sogm, {-1.3, 1, -9}, {-1, 1.3, 9});
  Sogm seen = empty_map({6, 6, 3}, 0.1, 2, kStart, 100ms);
  mark_box(&seen, {0, -9, -9}, {9, 9, 9}, 1, 1);  // its second frame: what was not seen
  const Vector3d unseen(1.15, 1.15, 0), stands(-1.15, 1.15, 0), near_unseen(1.45, 1.35, 0);
  for (const bool tells : {false, true, false}) {
    SCOPED_TRACE(tells);
    space.compose(sogm, {}, {{0, 0, 0}, kStart, 2.0, 2.0}, 0.0, tells ? &seen : nullptr);
    EXPECT_EQ(space.severity_at(unseen, 3), tells ? Severity::kEmergency : Severity::kCollision);
    EXPECT_EQ(space.severity_at(near_unseen, 3), Severity::kBlocked) << "the way out is less bad than the way in";
    EXPECT_EQ(space.severity_at(stands, 3), Severity::kCollision);
    EXPECT_TRUE(space.blocked_at(unseen, 0));
    const Sogm& standing = *space.compose_standing({}).sogm;
    EXPECT_EQ(standing.occupied(0, standing.geometry.voxel_of(unseen)), !tells);
    EXPECT_TRUE(standing.occupied(0, standing.geometry.voxel_of(stands)));
    ASSERT_EQ(space.seen() != nullptr, tells);
    // What is known besides counts where it is not seen, and there alone.
    Sogm known = empty_map({8, 8, 4}, 0.1, 1, kStart, 100ms);
    mark_box(&known, {-1.3, 1, -9}, {1.3, 1.3, 9});
    mark_box(&known, {1, -1.3, -9}, {1.3, -1, 9});
    space.add_known(nullptr);
    EXPECT_EQ(standing.occupied(0, standing.geometry.voxel_of(unseen)), !tells);
    space.add_known(&known);
    EXPECT_TRUE(standing.occupied(0, standing.geometry.voxel_of(unseen)));
    EXPECT_EQ(standing.occupied(0, standing.geometry.voxel_of({1.15, -1.15, 0})), tells);
    EXPECT_FALSE(standing.occupied(0, standing.geometry.voxel_of({-0.5, 1.15, 0})));
    if (!tells) continue;
    EXPECT_FALSE(space.seen()->occupied(0, sogm.geometry.voxel_of(unseen)));
    EXPECT_TRUE(space.seen()->occupied(0, sogm.geometry.voxel_of(stands)));
  }
}

// At a reported time the motion is blocked; and it was not blocked for 10 ms in a row before.
TEST(ConfigurationSpaceOfAPoint, FirstBlockedAgreesWithBruteForce) {
  Rng rng(3);
  int blocked = 0, by_the_tail = 0;
  Sogm sogm;
  ConfigurationSpace space({.radius_m = 0.0, .clearance_m = 0.0});
  for (int trial = 0; trial < 200; ++trial) {
    if (trial % 5 == 0) sogm = random_map(rng, uniform_int(rng, 1, 25), {4, 4, 3}, 10, kStart, 200ms);
    space.compose(sogm, {}, {});
    const Motion motion = random_motion(rng, kStart - uniform_duration(rng, 0us, 500ms), 1.8);
    const Utime from = kStart + uniform_duration(rng, -100ms, 2500ms);
    const auto is_blocked = [&](Utime t) {
      return sogm.occupied(sogm.frame_at(t), sogm.geometry.voxel_of(motion.at(t).position));
    };
    Utime in_a_row = kNever;
    int count = 0;
    const Utime map_end = kStart + 2s, end = std::max(motion.end_utime(), map_end);
    for (Utime t = from; t < end && in_a_row == kNever; t += 500us) {
      count = is_blocked(t) ? count + 1 : 0;
      if (count > 20) in_a_row = t;
    }
    const Utime reported = space.first_blocked(motion, from);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ", from " << (from - kStart).count() << ", reported "
                                    << (reported - kStart).count() << "\n"
                                    << motion);
    ASSERT_LE(reported, in_a_row);
    if (reported == kNever) continue;
    ++blocked;
    ASSERT_GE(reported, from);
    ASSERT_TRUE(is_blocked(reported));
    by_the_tail += reported > motion.end_utime();
  }
  EXPECT_GT(blocked, 30);
  EXPECT_LT(blocked, 190);
  EXPECT_GT(by_the_tail, 0);
}

TEST(FirstTouch, AgreesWithBruteForce) {
  Rng rng(7);
  int touched = 0;
  for (int trial = 0; trial < 200; ++trial) {
    Sogm sogm = random_bits({30, 30, 70}, 5, 0.002, 0.1, rng);
    sogm.start_utime = kStart;
    const Vector3d middle = sogm.geometry.center_of(sogm.geometry.size / 2);
    Motion motion = random_motion(rng, kStart - 300ms, 1.5);
    for (Trajectory* part : {&motion.committed, &motion.next}) {  // into the window
      for (int k = 0; !part->empty() && k <= part->num_pieces(); ++k) {
        MotionState knot = part->knot(k);
        knot.position += middle;
        part->set_knot(k, knot);
      }
    }
    const double radius = uniform(rng, 0.05, 0.4);
    const Utime from = kStart + uniform_duration(rng, 0us, 300ms), until = from + uniform_duration(rng, 0us, 800ms);
    Utime expected = kNever;
    for (Utime t = from; t <= until && expected > until; t += 20ms) {
      const Vector3d position = motion.at(t).position;
      for_each_column(sogm.geometry, [&](int x, int y) {
        for (int z = 0; z < sogm.geometry.size.z(); ++z) {
          if (sogm.occupied(sogm.frame_at(t), {x, y, z}) &&
              (sogm.geometry.center_of({x, y, z}) - position).norm() <= radius)
            expected = t;
        }
      });
    }
    ASSERT_EQ(first_touch(sogm, motion, radius, from, until), expected) << "trial " << trial;
    touched += expected <= until;
  }
  EXPECT_GT(touched, 30);
  EXPECT_LT(touched, 170);
}

}  // namespace
}  // namespace swarm
