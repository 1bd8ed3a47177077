// The planning cycle of the steady state takes no memory from the heap: every malloc of this program is counted.
#include <gtest/gtest.h>

#include "planner_daemon/planner.h"
#include "planner_daemon/rehearsal.h"
#include "tests/support/allocations.h"
#include "tests/support/harness.h"
#include "tests/support/random_map.h"
#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

#ifdef SWARM_COUNTS_ALLOCATIONS
namespace swarm {
namespace {

using Eigen::Vector3d;

using test::allocations_of, test::allocated_bytes;

TEST(Allocation, IsCounted) {
  std::vector<int> numbers;
  EXPECT_EQ(allocations_of([&] { numbers.push_back(1); }), 1);
  EXPECT_EQ(allocations_of([&] { numbers.back() = 2; }), 0);
  Eigen::VectorXd vector;
  EXPECT_EQ(allocations_of([&] { vector.setZero(1000); }), 1);
}

// Whatever happens: free flight, gaps, a start in blocked space, nothing that survives. Problems that were met before
// fit into the memory they needed then.
TEST(Allocation, PlanningTakesNoMemoryOnceItHasMetItsProblems) {
  Rng rng(1);
  PlannerConfig config;
  config.limits.space_min = {-4.9, -4.9, -0.9};
  config.limits.space_max = {4.9, 4.9, 0.9};
  Planner planner(config);
  constexpr int kRequests = 40;
  std::vector<Sogm> maps;
  std::vector<std::vector<Peer>> peers(kRequests);
  std::vector<PlanRequest> requests(kRequests);
  for (int i = 0; i < kRequests; ++i) maps.push_back(random_map(rng, 3 * (i % 12), {10, 10, 2}, 20, kStart, 100ms));
  for (std::size_t i = 0; i < kRequests; ++i) {
    for (std::size_t k = 0; k < i % 4; ++k)
      peers[i].push_back({random_motion(rng, kStart - 500ms, 3.0), Trajectory(), 0.2});
    requests[i].sogm = &maps[i];
    requests[i].peers = &peers[i];
    requests[i].own = {Trajectory::hover(1, kStart - 1s, in_box(rng, {-3, -3, -0.8}, {3, 3, 0.8})), {}};
    requests[i].start_utime = kStart + 50ms;
    requests[i].goal = in_box(rng, {-6, -6, -0.8}, {6, 6, 0.8});
  }
  std::array<int, 3> outcomes{};
  for (int round = 0; round < 3; ++round) {
    for (std::size_t i = 0; i < kRequests; ++i) {
      const int taken = allocations_of([&] {
        (void)planner.plan(requests[i]);
        planner.prepare(requests[i]);
      });
      const PlanResult& result = planner.plan(requests[i]);
      if (round == 0) continue;
      EXPECT_EQ(taken, 0) << "request " << i << ", " << to_string(result.outcome);
      ++outcomes[static_cast<std::size_t>(result.outcome)];
    }
  }
  EXPECT_GT(outcomes[static_cast<std::size_t>(PlanOutcome::kSmooth)], 20);
  EXPECT_GT(outcomes[static_cast<std::size_t>(PlanOutcome::kUnsafe)], 3);
}

// What the first plan after it, of a world that was not rehearsed, takes: little.
TEST(Allocation, RehearsedPlansFindTheirMemory) {
  Rng rng(2);
  PlannerConfig config;
  config.limits.space_min = {-4.9, -4.9, -0.9};
  config.limits.space_max = {4.9, 4.9, 0.9};
  const Sogm map = random_map(rng, 20, {10, 10, 2}, 20, kStart, 100ms);
  const std::vector<Peer> peers(2, {random_motion(rng, kStart - 500ms, 3.0), Trajectory(), 0.2});
  PlanRequest request;
  request.sogm = &map;
  request.peers = &peers;
  request.own = {Trajectory::hover(1, kStart - 1s, {-3, -3, 0}), {}};
  request.start_utime = kStart + 50ms;
  request.goal = {4, 4, 0};
  const auto bytes_of_plan = [&](bool is_rehearsed) {
    Planner planner(config);
    Rehearsal rehearsal(config.limits);
    while (is_rehearsed && rehearsal.plan(map, &planner)) continue;
    allocated_bytes = 0;
    (void)allocations_of([&] {
      (void)planner.plan(request);
      planner.prepare(request);
    });
    return allocated_bytes.load();
  };
  const std::size_t rehearsed = bytes_of_plan(true), first = bytes_of_plan(false);
  EXPECT_GT(first, 1'000'000u);
  EXPECT_LT(rehearsed, first / 20);
}

// Whoever got stuck looks for a way out voxel by voxel: the first time as well.
TEST(Allocation, RehearsedWaysOutFindTheirMemory) {
  PlannerConfig config;
  config.limits.space_min = {-4.9, -4.9, -0.9};
  config.limits.space_max = {4.9, 4.9, 0.9};
  Sogm map = empty_map({10, 10, 2}, 0.1, 20, kStart, 100ms);
  const GridGeometry& grid = map.geometry;
  for (int frame = 0; frame < map.num_frames; ++frame) {  // a wall, with a gap at its end
    for (int y = 10; y < grid.size.y(); ++y)
      set_run(0, grid.size.z(), grid.size.z(), map.column(frame, grid.size.x() / 2, y));
  }
  const std::vector<Peer> peers;
  const auto bytes_of_way_out = [&](bool is_rehearsed) {
    Planner planner(config);
    Rehearsal rehearsal(config.limits);
    while (is_rehearsed && rehearsal.plan(map, &planner)) continue;
    Sogm now = map;
    PlanRequest request;
    request.sogm = &now;
    request.peers = &peers;
    request.own = {Trajectory::hover(1, kStart - 1s, {-1, 3, 0}), {}};
    request.goal = {3, 3, 0};
    allocated_bytes = 0;
    for (int i = 0; i < 2; ++i) {  // the second time it came no nearer for three seconds
      now.start_utime = kStart + i * 3s;
      request.start_utime = now.start_utime + 50ms;
      (void)allocations_of([&] { (void)planner.plan(request); });
    }
    return allocated_bytes.load();
  };
  const std::size_t rehearsed = bytes_of_way_out(true), first = bytes_of_way_out(false);
  EXPECT_GT(first, 1'000'000u);
  EXPECT_LT(rehearsed, first / 20) << first;
}

}  // namespace
}  // namespace swarm
#else
TEST(Allocation, CannotBeCounted) {
  GTEST_SKIP() << "the allocator is not glibc's own";
}
#endif
