// Long because the promises of a plan are checked without the planner's own composition and by flying closed loops.
#include "planner_daemon/planner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "map_daemon/dilation.h"
#include "planner_daemon/coordination/deconfliction.h"
#include "planner_daemon/search/space_time_heuristic.h"
#include "tests/support/random_map.h"
#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using Eigen::Vector3d;

constexpr Duration kLead = 50ms, kPeriod = 100ms, kFrame = 200ms;
constexpr int kFrames = 11;

PlannerConfig flat_config() {
  PlannerConfig config;
  config.limits.space_min = {-4.9, -2.9, -0.9};
  config.limits.space_max = {4.9, 2.9, 0.9};
  return config;
}

Sogm map_at(Utime utime) {
  return empty_map({10, 6, 2}, 0.1, kFrames, utime, kFrame);
}

Motion hovering(const Vector3d& position) {
  return {Trajectory::hover(1, kStart - 1s, position), {}};
}

// Rest to rest along a line.
Trajectory line(Utime start_utime, Duration duration, const Vector3d& from, const Vector3d& to) {
  Trajectory trajectory(1, start_utime, duration, 1);
  MotionState state;
  state.position = from;
  trajectory.set_knot(0, state);
  state.position = to;
  trajectory.set_knot(1, state);
  return trajectory;
}

double least_distance(const Motion& a, const Motion& b, Utime from, Utime to) {
  double least = INFINITY;
  for (Utime t = from; t <= to; t += 1ms) {
    least = std::min(least, (a.at(t).position - b.at(t).position).norm());
  }
  return least;
}

// Obstacles and what the peers sweep, drawn from dense samples of their motions.
Sogm compose_independently(const PlanRequest& request) {
  Sogm occupied = *request.sogm;
  for (const Peer& peer : *request.peers) {
    std::vector<Motion> motions = {peer.motion};
    if (!peer.pending.empty()) motions.push_back({peer.motion.committed, peer.pending});
    for (const Motion& motion : motions) {
      for (int frame = 0; frame < occupied.num_frames; ++frame) {
        for (Duration t{}; t <= occupied.frame_duration; t += 5ms) {
          const Vector3d position = motion.at(occupied.start_utime + frame * occupied.frame_duration + t).position;
          mark_ball(&occupied, frame, position, peer.radius_m + occupied.geometry.resolution_m / 2);
        }
      }
    }
  }
  return occupied;
}

std::string describe(const PlanRequest& request, const PlanResult& result) {
  std::ostringstream out;
  out.precision(17);
  out << to_string(result.outcome) << (result.fly ? "" : ", own motion kept") << ", search "
      << to_string(result.search_status) << ", goal " << request.goal.transpose() << "\nown: " << request.own
      << "\nplan: " << result.trajectory;
  for (const Peer& peer : *request.peers) out << "\npeer " << peer.motion << "\npending: " << peer.pending;
  return out.str();
}

// What every flown plan promises. Free space is looked up here voxel by voxel: the voxel of the robot is farther than
// radius + clearance from all that is occupied, at each instant that is checked (10 ms, also of the search's own path).
// In between the robot travels from the nearest such instant of the same frame.
void check_plan(const PlanResult& result, const PlanRequest& request, const PlannerConfig& config) {
  const Trajectory& plan = result.trajectory;
  ASSERT_FALSE(plan.empty());
  ASSERT_EQ(plan.seq(), 0);
  ASSERT_EQ(plan.start_utime(), request.start_utime);
  if (result.outcome != PlanOutcome::kUnsafe || plan.piece() != config.search.piece / 2) {
    ASSERT_EQ(plan.piece(), config.search.piece);
  }
  const MotionState start = request.own.at(request.start_utime), first = plan.knot(0),
                    last = plan.knot(plan.num_pieces());
  Trajectory begins = plan;
  begins.set_knot(0, start);
  ASSERT_EQ(first.position, begins.knot(0).position);
  ASSERT_EQ(first.velocity, begins.knot(0).velocity);
  ASSERT_EQ(first.acceleration, begins.knot(0).acceleration);
  ASSERT_EQ(last.velocity, Vector3d::Zero());
  ASSERT_EQ(last.acceleration, Vector3d::Zero());
  for (Utime t = plan.start_utime(); t < plan.end_utime(); t += 1ms) {
    const MotionState state = plan.at(t);
    ASSERT_LE(state.velocity.cwiseAbs().maxCoeff(), 1.01 * config.limits.v_max_mps) << (t - plan.start_utime()).count();
    ASSERT_LE(state.acceleration.cwiseAbs().maxCoeff(), 1.006 * config.limits.axis_mps2().maxCoeff())
        << (t - plan.start_utime()).count();
  }
  ASSERT_TRUE(result.search_status != SearchStatus::kPartial || result.outcome == PlanOutcome::kUnsafe);
  if (!result.fly) return;
  for (Utime t = plan.start_utime(); t <= plan.end_utime(); t += 5ms) {  // safe or not
    const Vector3d position = plan.at(t).position;
    ASSERT_TRUE((position.array() > config.limits.space_min.array() - 2e-3).all() &&
                (position.array() < config.limits.space_max.array() + 2e-3).all())
        << (t - plan.start_utime()).count() << " us after the start: " << position.transpose();
  }
  if (result.outcome == PlanOutcome::kUnsafe) return;

  const Sogm occupied = compose_independently(request);
  const GridGeometry& grid = occupied.geometry;
  const double radius = config.space.radius_m + config.space.clearance_m;
  const auto free_at = [&](Utime t) {
    const Eigen::Vector3i voxel = grid.voxel_of(plan.at(t).position);
    return distance_to_occupied(occupied, occupied.frame_at(t), grid.center_of(voxel), radius + 0.01) > radius - 1e-6;
  };
  Utime from = request.start_utime;
  if (!free_at(from)) from += to_duration(config.search.leave_s);
  constexpr Duration step = 10ms;
  const Utime begin = request.start_utime + (from - request.start_utime + step - 1us) / step * step;
  const double half_diagonal = std::sqrt(3.0) / 2 * grid.resolution_m;
  for (Utime t = begin; t <= request.start_utime + 2s; t += 2500us) {
    const Utime before = begin + (t - begin) / step * step;
    ASSERT_TRUE(t != before || free_at(t)) << (t - request.start_utime).count() << " us after the start";
    Duration away = Duration::max();
    for (const Utime instant : {before, before + step}) {
      if (occupied.frame_at(instant) == occupied.frame_at(t)) away = std::min(away, std::chrono::abs(t - instant));
    }
    const double required = radius - half_diagonal - to_seconds(away) * 1.75 * config.limits.v_max_mps;
    ASSERT_GE(distance_to_occupied(occupied, occupied.frame_at(t), plan.at(t).position, radius), required)
        << (t - request.start_utime).count() << " us after the start";
  }
}

const std::vector<Peer> kNoPeers;

PlanRequest make_request(const Sogm& sogm, const Motion& own, const Vector3d& goal,
                         const std::vector<Peer>& peers = kNoPeers) {
  PlanRequest request;
  request.sogm = &sogm;
  request.own = own;
  request.start_utime = sogm.start_utime + kLead;
  request.goal = goal;
  request.peers = &peers;
  return request;
}

// Plans every 100 ms on the newest map, as the node does, and flies what comes out.
struct Flight {
  Motion own;
  std::vector<MotionState> states;  // every millisecond
  int smooth = 0, raw = 0, unsafe = 0;

  template <typename DrawMap>
  void run(const PlannerConfig& config, const Vector3d& goal, double seconds, const DrawMap& draw) {
    Planner planner(config);
    for (Utime now = kStart; now < kStart + to_duration(seconds); now += kPeriod) {
      if (!own.next.empty() && own.next.start_utime() <= now) own = {own.next, {}};
      Sogm sogm = map_at(now);
      draw(to_seconds(now - kStart), &sogm);
      const PlanRequest request = make_request(sogm, own, goal);
      const PlanResult& result = planner.plan(request);
      SCOPED_TRACE(testing::Message() << "at " << (now - kStart).count() << " us: " << describe(request, result));
      ASSERT_NO_FATAL_FAILURE(check_plan(result, request, config));
      smooth += result.outcome == PlanOutcome::kSmooth;
      raw += result.outcome == PlanOutcome::kRaw;
      unsafe += result.outcome == PlanOutcome::kUnsafe;
      if (result.fly) own.next = result.trajectory;
      planner.prepare(request);
      for (Utime t = now; t < now + kPeriod; t += 1ms) states.push_back(own.at(t));
    }
  }

  // When it is at the goal to stay [s], or infinity.
  double arrival_s(const Vector3d& goal) const {
    double arrival = INFINITY;
    for (std::size_t i = states.size(); i-- > 0 && (states[i].position - goal).norm() < 0.01;)
      arrival = 0.001 * static_cast<double>(i);
    return arrival;
  }
  double top_speed() const {
    double top = 0.0;
    for (const MotionState& state : states) top = std::max(top, state.velocity.cwiseAbs().maxCoeff());
    return top;
  }
};

TEST(PlannerTest, FliesStraightAndFastThroughEmptySpace) {
  const Vector3d goal(4, 0.03, 0.02);
  Flight flight{hovering({-4, 0.03, 0.02}), {}};
  ASSERT_NO_FATAL_FAILURE(flight.run(flat_config(), goal, 6.5, [](double, Sogm*) {}));
  EXPECT_EQ(flight.raw + flight.unsafe, 0);
  EXPECT_GT(flight.top_speed(), 1.9);
  EXPECT_LT(flight.arrival_s(goal), min_time_to_rest(8, 0, 2, 6) + 1.2);
  for (const MotionState& state : flight.states) ASSERT_LT(std::abs(state.position.y() - 0.03), 0.02);
}

TEST(PlannerTest, FindsTheGapInAWall) {
  const Vector3d goal(2.5, -0.5, 0.02);
  const auto wall = [](double, Sogm* sogm) {
    mark_box(sogm, {0.0, -9, -9}, {0.2, 0.4, 9});
    mark_box(sogm, {0.0, 1.4, -9}, {0.2, 9, 9});  // a gap of 1 m
  };
  Flight flight{hovering({-2.5, -0.5, 0.02}), {}};
  ASSERT_NO_FATAL_FAILURE(flight.run(flat_config(), goal, 5.5, wall));
  EXPECT_EQ(flight.unsafe, 0);
  EXPECT_LT(flight.arrival_s(goal), 5.5);
  double least = INFINITY;
  const Sogm sogm = [&] {
    Sogm map = map_at(kStart);
    wall(0, &map);
    return map;
  }();
  for (const MotionState& state : flight.states)
    least = std::min(least, distance_to_occupied(sogm, 0, state.position, 0.5));
  EXPECT_GT(least, 0.2);
}

// Through the gap, with what a body of limited tilt and jerk can do.
TEST(PlannerTest, FliesWithinJerkAndThrust) {
  PlannerConfig config = flat_config();
  config.limits.kind = "thrust";
  config.limits.thrust = {4.0, 16.0, 30.0};
  config.limits.j_max_mps3 = 40.0;
  const Vector3d goal(2.5, -0.5, 0.02);
  const auto wall = [](double, Sogm* sogm) {
    mark_box(sogm, {0.0, -9, -9}, {0.2, 0.4, 9});
    mark_box(sogm, {0.0, 1.6, -9}, {0.2, 9, 9});
  };
  Flight flight{hovering({-2.5, -0.5, 0.02}), {}};
  ASSERT_NO_FATAL_FAILURE(flight.run(config, goal, 8.0, wall));
  EXPECT_EQ(flight.unsafe, 0);
  EXPECT_GT(flight.smooth, 3 * flight.raw);
  EXPECT_LT(flight.arrival_s(goal), 8.0);
  double most_tilt_deg = 0.0, most_mps3 = 0.0;
  for (const MotionState& state : flight.states) {
    const Vector3d thrust = state.acceleration + Vector3d(0, 0, 9.81);
    most_tilt_deg = std::max(most_tilt_deg, std::acos(thrust.z() / thrust.norm()) * 180.0 / M_PI);
    most_mps3 = std::max(most_mps3, state.jerk.cwiseAbs().maxCoeff());
  }
  EXPECT_LT(most_tilt_deg, 30.2);
  EXPECT_GT(most_tilt_deg, 20.0);
  EXPECT_LT(most_mps3, 1.01 * 40.0);
  EXPECT_GT(most_mps3, 20.0);
}

TEST(PlannerTest, LetsAMovingColumnPass) {
  const Vector3d goal(3, 0.03, 0.02);
  const auto column_at = [](double t) {
    return Vector3d(0.0, 1.6 - 0.8 * t, 0.0);
  };  // at (0, 0) when the robot would be
  const auto draw = [&](double t, Sogm* sogm) { mark_moving(sogm, column_at(t), {0, -0.8, 0}, 0.4, true); };
  Flight flight{hovering({-3, 0.03, 0.02}), {}};
  ASSERT_NO_FATAL_FAILURE(flight.run(flat_config(), goal, 5.5, draw));
  EXPECT_EQ(flight.unsafe, 0);
  EXPECT_LT(flight.arrival_s(goal), 5.5);
  for (std::size_t i = 0; i < flight.states.size(); ++i) {
    const Vector3d offset = flight.states[i].position - column_at(0.001 * static_cast<double>(i));
    ASSERT_GT(offset.head<2>().norm(), 0.4 + 0.2) << "at " << i << " ms";
  }
}

// A column that goes away might turn: where it just was is given a wide margin.
TEST(PlannerTest, KeepsOutOfWhatWasRecentlyOccupied) {
  const auto samples_there = [](double recently_occupied_s) {
    PlannerConfig config = flat_config();
    config.space.recently_occupied_s = recently_occupied_s;
    Planner planner(config);
    Sogm sogm = map_at(kStart);
    const Vector3d from(0, -0.2, 0), velocity(0, 0.7, 0);
    mark_moving(&sogm, from, velocity, 0.3, true);
    const PlanRequest request = make_request(sogm, hovering({-1.2, 0.03, 0.02}), {4, 0.03, 0.02});
    const PlanResult& result = planner.plan(request);
    EXPECT_TRUE(result.fly);
    EXPECT_NE(result.outcome, PlanOutcome::kUnsafe);
    int samples = 0;
    for (Utime t = result.trajectory.start_utime(); t < result.trajectory.end_utime(); t += 5ms) {
      // Where the column was 0.3 s ago, and the robot's size with some room.
      const Vector3d was = from + (to_seconds(t - kStart) - 0.3) * velocity;
      samples += (result.trajectory.at(t).position - was).head<2>().norm() < 0.3 + 0.2;
    }
    return samples;
  };
  const int without = samples_there(0.0);
  EXPECT_GT(without, 10);
  EXPECT_LT(samples_there(0.8), without / 3);
}

// The way past a silent peer keeps the margin around it where it can; the curve must not cut the corner that this
// makes.
TEST(PlannerTest, SmoothsOutsideTheMarginAroundSilentPeers) {
  PlannerConfig config = flat_config();
  config.limits.space_min.z() = -0.3;  // past it, not over it
  config.limits.space_max.z() = 0.3;
  Planner planner(config);
  Rng rng(5);
  const auto place = [&](double x_m) { return Vector3d(x_m, uniform(rng, -0.5, 0.5), 0.02); };
  int smooth = 0, within = 0;
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<Peer> peers(1);
    const Vector3d peer(uniform(rng, -0.5, 1.5), uniform(rng, -0.6, 0.6), 0.0);
    peers[0].motion = hovering(peer);
    peers[0].silent = true;
    const Sogm sogm = map_at(kStart);
    const Vector3d from = place(-4.0), to = place(-1.0);
    const Motion own{line(kStart - 1500ms, 3s, from, to), {}};  // 1.9 m/s on the way there
    const PlanRequest request = make_request(sogm, own, place(4.5), peers);
    const PlanResult& result = planner.plan(request);
    smooth += result.outcome == PlanOutcome::kSmooth;
    const Trajectory& plan = result.trajectory;
    const double least_m = least_distance({plan, {}}, peers[0].motion, plan.start_utime(), plan.end_utime());
    within += least_m < peers[0].radius_m + config.space.blocked_m() + config.space.silent_peer_margin_m - 0.05;
  }
  EXPECT_GT(smooth, 190);
  EXPECT_LT(within, 90);  // 131 where the curve may cut
}

// A dead end appears in front of the robot: whoever prepares the next plans knows it before what looks far ahead is
// due.
TEST(PlannerTest, LooksFarAheadBetweenPlans) {
  const Vector3d from(0.03, 0.03, 0.02), goal(4, 0.03, 0.02);
  PlannerConfig config = flat_config();
  config.limits.space_min.z() = -0.7;  // no way leads over the walls
  config.limits.space_max.z() = 0.7;
  const auto end_x = [&](void (Planner::*prepare)(const PlanRequest&)) {
    Planner planner(config);
    double x = NAN;
    for (const auto& [after, is_closed] : {std::pair{0ms, false}, {390ms, false}, {450ms, true}, {480ms, true}}) {
      Sogm sogm = map_at(kStart + after);
      if (is_closed) {
        mark_box(&sogm, {0.8, -1.3, -9}, {1.0, 1.3, 9});
        for (const double side : {-1.3, 1.2}) mark_box(&sogm, {-0.8, side, -9}, {1.0, side + 0.1, 9});
      }
      const PlanRequest request = make_request(sogm, hovering(from), goal);
      const Trajectory& trajectory = planner.plan(request).trajectory;
      x = trajectory.at(trajectory.end_utime()).position.x();
      if (prepare != nullptr) (planner.*prepare)(request);
    }
    return x;
  };
  EXPECT_GT(end_x(nullptr), -0.05);
  EXPECT_LT(end_x(&Planner::prepare), -0.3);
  EXPECT_LT(end_x(&Planner::prepare_meanwhile), -0.3);
}

TEST(PlannerTest, StopsBesideAnOccupiedGoal) {
  const Vector3d goal(1, 0.03, 0.02);
  Flight flight{hovering({-0.5, 0.03, 0.02}), {}};
  ASSERT_NO_FATAL_FAILURE(flight.run(flat_config(), goal, 3.0,
                                     [&](double, Sogm* sogm) { mark_moving(sogm, goal, Vector3d::Zero(), 0.3); }));
  EXPECT_EQ(flight.unsafe, 0);
  const Vector3d end = flight.states.back().position;
  EXPECT_GT((end - goal).norm(), 0.45);  // voxels are centres here: no margin around them
  EXPECT_LT((end - goal).norm(), 0.7);
  EXPECT_LT(flight.arrival_s(end), 2.4);
}

// A peer counts with all that it may fly: committed, next and pending.
TEST(PlannerTest, KeepsClearOfPeers) {
  const PlannerConfig config = flat_config();
  const Motion own = hovering({-1.5, 0.03, 0.02});
  const Vector3d goal(3, 0.03, 0.02), away(0.0, 2.5, 0.5);
  const Sogm sogm = map_at(kStart);
  std::vector<Peer> cases(5);
  cases[0].motion = hovering({0.0, 0.1, 0.0});
  cases[1].motion = {line(kStart, 1600ms, {2.0, 0.0, 0.0}, {-2.5, 0.0, 0.0}), {}};  // head on
  cases[2].motion = hovering(away);
  cases[2].motion.next = line(kStart + 130ms, 700ms, away, {0.0, 0.0, 0.0});  // comes in between two frames' bounds
  cases[3].motion = hovering(away);
  cases[3].pending = line(kStart + 130ms, 700ms, away, {0.0, 0.0, 0.0});
  cases[4].motion = hovering({0.0, 0.1, 0.0});
  cases[4].pending = line(kStart + 100ms, 700ms, {0.0, 0.1, 0.0}, away);  // announces to leave: may stay as well
  Planner planner(config);
  PlanRequest request = make_request(sogm, own, goal);
  const Trajectory regardless = planner.plan(request).trajectory;
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const std::vector<Peer> peers = {cases[i]};
    request.peers = &peers;
    const PlanResult& result = planner.plan(request);
    SCOPED_TRACE(testing::Message() << "case " << i << ": " << describe(request, result));
    ASSERT_NE(result.outcome, PlanOutcome::kUnsafe);
    ASSERT_NO_FATAL_FAILURE(check_plan(result, request, config));
    std::vector<Motion> motions = {cases[i].motion};
    if (!cases[i].pending.empty()) motions.push_back({cases[i].motion.committed, cases[i].pending});
    double least = INFINITY, least_regardless = INFINITY;
    for (const Motion& motion : motions) {
      EXPECT_TRUE(motions_separated({result.trajectory, {}}, motion, request.start_utime, 0.4));
      const Utime end = request.start_utime + 2s;
      least = std::min(least, least_distance({result.trajectory, {}}, motion, request.start_utime, end));
      least_regardless = std::min(least_regardless, least_distance({regardless, {}}, motion, request.start_utime, end));
    }
    EXPECT_GT(least, 0.4);
    EXPECT_LT(least_regardless, 0.4) << "the peer is not in the way";
  }
}

TEST(PlannerTest, LeavesBlockedSpaceInTime) {
  const PlannerConfig config = flat_config();
  Planner planner(config);
  Sogm sogm = map_at(kStart);
  mark_box(&sogm, {0.2, -9, -9}, {0.4, 9, 9});
  const PlanRequest request = make_request(sogm, hovering({-0.03, 0.03, 0.02}), {-3, 0, 0});
  const PlanResult& result = planner.plan(request);
  SCOPED_TRACE(describe(request, result));
  ASSERT_NE(result.outcome, PlanOutcome::kUnsafe);
  ASSERT_NO_FATAL_FAILURE(check_plan(result, request, config));
  for (Duration t{}; t < 2s; t += 1ms) {
    const double x = result.trajectory.at(request.start_utime + t).position.x();
    ASSERT_LT(x, t < 450ms ? 0.0 : -0.1) << t.count();
  }
}

// Half of the space fills up at 0.8 s. The own motion, faster than any plan may be, escapes: it is the better one.
TEST(PlannerTest, KeepsTheOwnMotionWhenNoPlanIsBetter) {
  const PlannerConfig config = flat_config();
  Planner planner(config);
  Sogm sogm = map_at(kStart);
  mark_box(&sogm, {-9, -9, -9}, {2.0, 9, 9}, 4, kFrames);
  Motion own = hovering({0.03, 0.03, 0.02});
  PlanRequest request = make_request(sogm, own, {3, 0, 0});
  request.own.next = line(request.start_utime, 700ms, {0.03, 0.03, 0.02}, {3.5, 0.03, 0.02});
  const PlanResult& kept = planner.plan(request);
  EXPECT_EQ(kept.outcome, PlanOutcome::kUnsafe);
  EXPECT_FALSE(kept.fly);
  EXPECT_EQ(kept.search_status, SearchStatus::kPartial);

  request.own.next = line(request.start_utime, 700ms, {0.03, 0.03, 0.02}, {-0.9, 0.03, 0.02});
  mark_box(&sogm, {-9, -9, -9}, {-0.45, 9, 9}, 0, 3);  // and this one flies into a wall before that
  const PlanResult& flown = planner.plan(request);
  EXPECT_EQ(flown.outcome, PlanOutcome::kUnsafe);
  EXPECT_TRUE(flown.fly);
  ASSERT_NO_FATAL_FAILURE(check_plan(flown, request, config));
}

// A search that gets stuck early does not replace what an earlier one found, unless it ends nearer to the goal.
TEST(PlannerTest, StuckItKeepsAnEarlierPlanThatEndsNearerToTheGoal) {
  const Vector3d goal(8, 0.03, 0.02);
  PlannerConfig config = flat_config();
  Planner thorough(config);
  config.search.max_expansions = 3;
  Planner hasty(config);
  const Sogm sogm = map_at(kStart);
  PlanRequest request = make_request(sogm, hovering({-4, 0.03, 0.02}), goal);
  const PlanResult& far = thorough.plan(request);
  ASSERT_EQ(far.search_status, SearchStatus::kSurvives);
  ASSERT_TRUE(far.fly);
  EXPECT_TRUE(hasty.plan(request).fly) << "better than to hover";

  request.own.next = far.trajectory;
  request.start_utime += 100ms;
  const PlanResult& near = hasty.plan(request);
  EXPECT_EQ(near.search_status, SearchStatus::kSurvives);
  EXPECT_NE(near.outcome, PlanOutcome::kUnsafe);
  EXPECT_FALSE(near.fly);
  EXPECT_TRUE(thorough.plan(request).fly) << "not stuck";
  request.goal = {-8, 0.03, 0.02};
  EXPECT_TRUE(hasty.plan(request).fly) << "the own motion flies away from the goal";
  Sogm walled = sogm;
  mark_box(&walled, {-1.0, -9, -9}, {-0.8, 9, 9});
  request.sogm = &walled;
  request.goal = goal;
  EXPECT_TRUE(hasty.plan(request).fly) << "the own motion flies into a wall";
}

// A wall appears before the goal: the way around it is known at once for another goal, otherwise a quarter of a second
// after the static heuristic was made. It stands near, so that it is forgotten when it is gone.
TEST(PlannerTest, StaticHeuristicServesPlansForAWhile) {
  const PlannerConfig config = flat_config();
  Planner planner(config);
  const auto detour_s = [&](Utime utime, bool walled, const Vector3d& goal) {
    Sogm sogm = map_at(utime);
    if (walled) mark_box(&sogm, {1.6, -1.6, -9}, {2.0, 1.6, 9});
    planner.plan(make_request(sogm, hovering({0.03, 0.03, 0.02}), goal));
    const SpaceTimeHeuristic& delays = *planner.search_problem().heuristic;
    const int last = delays.num_steps();
    const Vector3d place(1.05, 0.1, 0.1);
    const double delay_s = delays.delay_s(last, delays.cell_of(last, 0, place.x()), delays.cell_of(last, 1, place.y()),
                                          delays.cell_of(last, 2, place.z()));
    const auto straight_s = [&](const Vector3d& to) {
      return (to - place).cwiseAbs().maxCoeff() / (config.limits.v_max_mps * Planner::kUsableSpeed);
    };
    return delay_s + delays.rest_s() + straight_s(delays.target()) - straight_s(goal);
  };
  const Vector3d goal(4.5, 0.1, 0.1);
  constexpr double kRounding_s = 0.05;
  EXPECT_NEAR(detour_s(kStart, false, goal), 0.0, kRounding_s);
  EXPECT_NEAR(detour_s(kStart + 100ms, true, goal), 0.0, kRounding_s);
  EXPECT_NEAR(detour_s(kStart + 425ms, true, goal), 0.0, kRounding_s);
  EXPECT_GT(detour_s(kStart + 500ms, true, goal), 0.3);
  EXPECT_GT(detour_s(kStart + 580ms, false, goal), 0.3);
  EXPECT_NEAR(detour_s(kStart + 590ms, false, {4.5, 0.2, 0.1}), 0.0, kRounding_s);
  EXPECT_GT(detour_s(kStart + 590ms, true, {4.5, 0.2, 0.1}), 0.3);  // the time has not moved on: another log, a reset
  EXPECT_NEAR(detour_s(kStart, false, {4.5, 0.2, 0.1}), 0.0, kRounding_s);
}

// In a closed cage the search is stuck: it takes finer steps in every other plan, and usual ones again in the open.
TEST(PlannerTest, AStuckSearchTakesFinerStepsInTurns) {
  PlannerConfig config = flat_config();
  config.search.max_expansions = 80;
  Planner planner(config);
  Utime utime = kStart;
  const auto takes_finer_steps = [&](bool caged) {
    Sogm sogm = map_at(utime += 50ms);
    for (const double side : {-1.4, 1.2}) {
      if (caged) mark_box(&sogm, {side, -1.4, -9}, {side + 0.2, 1.4, 9});
      if (caged) mark_box(&sogm, {-1.4, side, -9}, {1.4, side + 0.2, 9});
    }
    const PlanResult& result = planner.plan(make_request(sogm, hovering({0.03, 0.03, 0.02}), {4.5, 0.1, 0.1}));
    EXPECT_EQ(result.search_status, SearchStatus::kSurvives);
    EXPECT_LE(result.expansions, config.search.max_expansions);
    return planner.search_problem().fine;
  };
  EXPECT_FALSE(takes_finer_steps(true));
  EXPECT_TRUE(takes_finer_steps(true));
  EXPECT_FALSE(takes_finer_steps(true));
  EXPECT_TRUE(takes_finer_steps(false));
  EXPECT_FALSE(takes_finer_steps(false));
  EXPECT_FALSE(takes_finer_steps(false));
}

// A wall appears in front of the robot: the space-time heuristic knows of it in the maps themselves, but serves for two
// of them.
TEST(PlannerTest, SpaceTimeHeuristicServesTheNextMap) {
  Planner planner(flat_config());
  const Vector3d start(0.03, 0.03, 0.02);
  const auto delay_s = [&](Utime utime, bool walled, const Vector3d& goal) {
    Sogm sogm = map_at(utime);
    if (walled) mark_box(&sogm, {0.9, -2.0, -9}, {1.3, 2.0, 9});
    planner.plan(make_request(sogm, hovering(start), goal));
    const SpaceTimeHeuristic& delays = *planner.search_problem().heuristic;
    return delays.delay_s(0, delays.cell_of(0, 0, start.x()), delays.cell_of(0, 1, start.y()),
                          delays.cell_of(0, 2, start.z()));
  };
  const Vector3d goal(4.5, 0.1, 0.1);
  EXPECT_EQ(delay_s(kStart, false, goal), 0.0);
  EXPECT_EQ(delay_s(kStart + 50ms, true, goal), 0.0);
  EXPECT_GT(delay_s(kStart + 75ms, true, goal), 0.3);
  EXPECT_GT(delay_s(kStart + 125ms, false, goal), 0.3);
  EXPECT_EQ(delay_s(kStart + 130ms, false, {4.5, 0.2, 0.1}), 0.0);
}

// Weighted as the planner does.
double jerk_cost(const Trajectory& trajectory) {
  double sum = 0.0;
  for (Duration t = 500us; t < trajectory.end_utime() - trajectory.start_utime(); t += 1ms) {
    const double weight = Planner::jerk_weight(static_cast<int>(to_seconds(t) / trajectory.piece_s()));
    sum += 0.001 * weight * trajectory.at(trajectory.start_utime() + t).jerk.squaredNorm();
  }
  return sum;
}

TEST(PlannerTest, SmoothingLowersTheJerkOfTheSearchedPathInsideItsCorridors) {
  Rng rng(1);
  PlannerConfig config = flat_config();
  config.space.recently_occupied_s = 0.0;
  config.corridor.margin_m = 0.0;  // which is worth some jerk
  Planner planner(config);
  SearchLimits limits = config.limits;
  limits.v_max_mps *= Planner::kUsableSpeed;
  KinodynamicSearch search(limits, config.search);
  int compared = 0, much_better = 0;
  double closest_m = 1.0;
  for (int trial = 0; trial < 30; ++trial) {
    Sogm sogm = map_at(kStart);
    for (int i = 0; i < 12; ++i)
      mark_moving(&sogm, in_box(rng, {-4, -3, -1}, {4, 3, 1}), in_cube(rng, 0.8), 0.3, i % 2 == 0);
    const PlanRequest request = make_request(sogm, hovering(in_box(rng, {-4, -2, -0.8}, {4, 2, 0.8})),
                                             in_box(rng, {-4, -2, -0.8}, {4, 2, 0.8}));
    const PlanResult& result = planner.plan(request);
    if (result.outcome != PlanOutcome::kSmooth) continue;
    const MotionState start = request.own.at(request.start_utime);
    const ReachableSet reach{start.position,    request.start_utime,
                             limits.v_max_mps,  to_seconds(config.search.piece) * config.search.num_pieces,
                             limits.a_max_mps2, start.velocity};
    ConfigurationSpace space(config.space);  // all of it worked out beforehand
    space.compose(sogm, {}, reach);
    (void)space.layers(0, sogm.num_frames - 1, all_columns(sogm.geometry));
    Sogm still;  // occupied in every frame
    still.reset(sogm.geometry, 1, kStart, sogm.frame_duration);
    const auto words = still.words_to_write();
    for (std::size_t i = 0; i < words.size(); ++i) {
      words[i] = ~std::uint64_t{0};
      for (int frame = 0; frame < sogm.num_frames; ++frame) words[i] &= sogm.column(frame, 0, 0)[i];
    }
    SearchProblem problem;
    problem.fine = planner.search_problem().fine;  // after a plan that got stuck
    problem.start = start;
    problem.start_utime = request.start_utime;
    problem.goal = request.goal;
    problem.space = &space;
    SpaceTimeHeuristic heuristic;
    StaticHeuristic static_heuristic;
    const double blocked_m = config.space.blocked_m();
    static_heuristic.build({&still}, blocked_m, request.goal, {limits.space_min, limits.space_max}, nullptr);
    heuristic.build({&sogm}, blocked_m, &static_heuristic, reach, request.goal, limits.space_min, limits.space_max);
    problem.heuristic = &heuristic;
    SearchResult path;
    SCOPED_TRACE(testing::Message() << "trial " << trial << ": " << describe(request, result));
    const SearchStatus status = search.find(problem, &path);
    if (path.settled || path.left_blocked) continue;  // then the planner looked again
    ++compared;
    ASSERT_EQ(status, result.search_status);
    ASSERT_EQ(path.expansions, result.expansions);  // the same search
    ASSERT_EQ(path.num_pieces, result.trajectory.num_pieces());
    Trajectory raw(0, request.start_utime, config.search.piece, path.num_pieces);
    for (int k = 0; k <= path.num_pieces; ++k) raw.set_knot(k, path.knots[static_cast<std::size_t>(k)]);
    const double before = jerk_cost(raw), after = jerk_cost(result.trajectory);
    ASSERT_LE(after, before * 1.001 + 1e-6);
    much_better += after < 0.8 * before;
    ASSERT_EQ(result.corridors.size(), static_cast<std::size_t>(path.num_pieces));
    for (Utime t = raw.start_utime(); t < raw.end_utime(); t += 1ms) {
      const auto piece = static_cast<std::size_t>((t - raw.start_utime()) / raw.piece());
      const Polytope& corridor = result.corridors[piece];
      const Vector3d position = result.trajectory.at(t).position;
      ASSERT_LE(corridor.violation(position), 1e-4) << (t - raw.start_utime()).count();
      // Off its faces by the margin, or as far as the path is.
      const ControlPoints points =
          quintic_control_points(path.knots[piece], path.knots[piece + 1], to_seconds(raw.piece()));
      const double margin_m = config.corridor.margin_m;
      for (int i = 0; i < corridor.num_faces(); ++i) {
        const double of_path_m = corridor.offsets(i) - (corridor.normals.row(i) * points).maxCoeff();
        const double off_m = corridor.offsets(i) - corridor.normals.row(i).dot(position);
        ASSERT_GE(off_m, std::min(margin_m, of_path_m) - 1e-4) << (t - raw.start_utime()).count();
        closest_m = std::min(closest_m, off_m);
      }
    }
  }
  EXPECT_GT(compared, 12);
  EXPECT_GT(much_better, compared / 2);
  EXPECT_LT(closest_m, 0.5 * config.corridor.margin_m) << "some paths are closer";
}

TEST(PlannerTest, RandomScenesKeepAllPromisesAndRepeatBitForBit) {
  Rng rng(2);
  const PlannerConfig config = flat_config();
  Planner planner(config);
  std::array<int, 3> seen{};
  for (int trial = 0; trial < 30; ++trial) {
    Sogm sogm = map_at(kStart - Duration(uniform_int(rng, 0, 150'000)));
    for (int i = uniform_int(rng, 0, 18); i > 0; --i) {
      mark_moving(&sogm, in_box(rng, {-4, -3, -1}, {4, 3, 1}), in_cube(rng, 0.8), uniform(rng, 0.1, 0.5), i % 2 == 0);
    }
    std::vector<Peer> peers(static_cast<std::size_t>(uniform_int(rng, 0, 4)));
    for (Peer& peer : peers) {
      peer.motion = random_motion(rng, kStart - Duration(uniform_int(rng, 0, 2'000'000)), 2.5);
      peer.radius_m = uniform(rng, 0.1, 0.4);
      if (uniform_int(rng, 0, 1) == 1) {
        const Utime leave = kStart + Duration(uniform_int(rng, 0, 300'000));
        peer.pending = random_trajectory(rng, 2, leave, peer.motion.committed.at(leave), 2.5);
      }
    }
    // On the way somewhere: the motion of a plan made in empty space.
    const Sogm empty = map_at(kStart - 700ms);
    const Vector3d goal = in_box(rng, {-4, -2, -0.8}, {4, 2, 0.8});
    const PlanRequest earlier = make_request(empty, hovering(in_box(rng, {-4, -2, -0.8}, {4, 2, 0.8})), goal);
    Motion own = earlier.own;
    own.next = planner.plan(earlier).trajectory;
    const PlanRequest request = make_request(sogm, own, goal, peers);
    const PlanResult result = planner.plan(request);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ": " << describe(request, result));
    ASSERT_NO_FATAL_FAILURE(check_plan(result, request, config));
    ++seen[static_cast<std::size_t>(result.outcome)];

    Planner fresh(config);
    const PlanResult& again = fresh.plan(request);
    ASSERT_EQ(again.outcome, result.outcome);
    ASSERT_EQ(again.fly, result.fly);
    ASSERT_EQ(again.search_status, result.search_status);
    ASSERT_EQ(again.expansions, result.expansions);
    const sogm_swarm::trajectory_t a = result.trajectory.to_wire(), b = again.trajectory.to_wire();
    ASSERT_EQ(a.num_pieces, b.num_pieces);
    ASSERT_EQ(std::memcmp(a.knots, b.knots, sizeof(a.knots)), 0);
    ASSERT_EQ(again.corridors.size(), result.corridors.size());
    for (std::size_t i = 0; i < again.corridors.size(); ++i) {
      ASSERT_EQ(again.corridors[i].normals, result.corridors[i].normals);
      ASSERT_EQ(again.corridors[i].offsets, result.corridors[i].offsets);
    }
  }
  EXPECT_GT(seen[static_cast<std::size_t>(PlanOutcome::kSmooth)], 10);
  EXPECT_GT(seen[static_cast<std::size_t>(PlanOutcome::kUnsafe)], 0);
}

// A start too fast to keep the limits from: then the smooth trajectory has to be within them all the same, or is not
// taken.
TEST(PlannerTest, SmoothTrajectoriesKeepTheLimitsFromAnyStart) {
  Rng rng(4);
  const PlannerConfig config = flat_config();
  Planner planner(config);
  const Sogm sogm = map_at(kStart);
  int smooth = 0, other = 0;
  for (int trial = 0; trial < 50; ++trial) {
    Motion own{Trajectory(1, kStart + kLead, 1s, 1), {}};
    own.committed.set_knot(0, random_state(rng, 0.5, 2, 6));
    own.committed.set_knot(1, MotionState{});
    const PlanRequest request = make_request(sogm, own, in_cube(rng, 4));
    const PlanResult& result = planner.plan(request);
    SCOPED_TRACE(testing::Message() << "trial " << trial << ": " << describe(request, result));
    if (result.outcome == PlanOutcome::kSmooth) {
      ++smooth;
      ASSERT_NO_FATAL_FAILURE(check_plan(result, request, config));
    } else {
      ++other;
    }
  }
  EXPECT_GT(smooth, 10);
  EXPECT_GT(other, 2);
}

// A slab comes down upon the robot: it is not evaded through the floor.
TEST(PlannerTest, NothingDrivesTheRobotOutOfTheFlightSpace) {
  Rng rng(1);
  PlannerConfig config;
  config.limits.space_min = {-8, -8, 0.2};
  config.limits.space_max = {8, 8, 3.8};
  Planner planner(config);
  int without_way_out = 0;
  for (int trial = 0; trial < 400; ++trial) {
    Sogm sogm = empty_map({6, 6, 4}, 0.1, 20, kStart, 100ms);
    sogm.geometry.origin.z() = 0;
    const double speed = uniform(rng, 0.5, 3.0), height = uniform(rng, 1.2, 2.8);
    for (int frame = 0; frame < sogm.num_frames; ++frame) {
      const double bottom = std::max(height - speed * 0.1 * (frame + 1), uniform(rng, 0.3, 0.9));
      mark_box(&sogm, {-9, -9, bottom}, {9, 9, 9}, frame, frame);
    }
    const PlanRequest request = make_request(sogm, hovering({0, 0, uniform(rng, 0.3, 1.0)}), {3, 0, 1});
    const PlanResult& result = planner.plan(request);
    without_way_out += result.search_status == SearchStatus::kPartial;
    SCOPED_TRACE(testing::Message() << "trial " << trial << ": " << describe(request, result));
    ASSERT_NO_FATAL_FAILURE(check_plan(result, request, config));
  }
  EXPECT_GT(without_way_out, 100);
}

TEST(PlannerTest, TimesItsStepsWithTheStopwatchOnly) {
  const Sogm sogm = map_at(kStart);
  const PlanRequest request = make_request(sogm, hovering({0, 0, 0}), {1, 0, 0});
  Planner untimed(flat_config());
  for (double ms : untimed.plan(request).step_ms) EXPECT_EQ(ms, 0.0);
  std::chrono::nanoseconds now{};
  Planner timed(flat_config(), [&] { return now += 1ms; });
  for (double ms : timed.plan(request).step_ms) EXPECT_DOUBLE_EQ(ms, 1.0);
}

TEST(PlannerTest, RefusesAHorizonTooShortToBrake) {
  PlannerConfig config = flat_config();
  config.search.num_pieces = 3;
  EXPECT_THROW(Planner{config}, std::invalid_argument);
}

}  // namespace
}  // namespace swarm
