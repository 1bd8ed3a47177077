// The planner daemon's node: from what and towards what it plans, and what it makes of bad input. Long because every
// message that it hears is tried, good and bad.
#include "planner_daemon/planner_node.h"

#include <algorithm>
#include <random>

#include "planner_daemon/coordination/deconfliction.h"
#include "tests/support/planner_node_fixture.h"
#include "tests/support/random_map.h"

namespace swarm::test {
namespace {

using Fixture = PlannerNodeFixture;

TEST(PlannerNode, StatusNamesWhatIsMissing) {
  Fixture f;
  EXPECT_EQ(f.status().state, planner_status_t::kNoMap);
  const auto state_after_a_second = [&f] {
    f.run_for(0.9);
    f.send_map();
    f.run_for(0.1);
    return f.status().state;
  };
  EXPECT_EQ(state_after_a_second(), planner_status_t::kNoCommitted);
  EXPECT_EQ(f.node.plans(), 0);
  f.send_hover();
  EXPECT_EQ(state_after_a_second(), planner_status_t::kPlanning);  // of the plan itself, made without a goal
  EXPECT_EQ(f.node.plans(), 2);
  f.run_for(0.15);
  EXPECT_EQ(state_after_a_second(), planner_status_t::kPlanning);
  f.run_for(1.0);
  EXPECT_EQ(f.status().state, planner_status_t::kStaleMap);
  EXPECT_EQ(f.status().plans, f.node.plans());
}

TEST(PlannerNode, StatusNamesAMissingGoal) {
  PlannerNodeConfig config = Fixture::make_config();
  config.stale_map_s = 10.0;
  Fixture f(config);
  f.send_hover();
  f.send_map();
  f.run_for(1.5);
  EXPECT_EQ(f.status().state, planner_status_t::kNoGoal);
  f.send_goal({1, 0, 1});
  f.run_for(1.0);
  EXPECT_EQ(f.status().state, planner_status_t::kPlanning);
}

TEST(PlannerNode, StatusSaysThatNoWayLeadsToTheGoal) {
  PlannerNodeConfig config = Fixture::make_config();
  config.planner.limits.space_max.z() = 3.0;
  Fixture f(config);
  f.start({1, 0, 4});
  EXPECT_EQ(f.status().state, planner_status_t::kUnreachable);
  f.send_goal({1, 0, 1});
  f.run_for(0.3);
  f.send_map();
  EXPECT_EQ(f.status().state, planner_status_t::kPlanning);
}

// A wall from side to side: no way leads through it, unless it is one only because nobody saw what is there.
TEST(PlannerNode, WaysMayLeadThroughWhatWasNotSeen) {
  for (const bool was_seen : {true, false}) {
    SCOPED_TRACE(was_seen);
    PlannerNodeConfig config = Fixture::make_config();
    config.planner.limits.space_min = {-4, -4, 0};
    config.planner.limits.space_max = {4, 4, 2};
    Fixture f(config);
    mark_box(&f.map, {2.0, -9, -9}, {2.4, 9, 9});
    Sogm seen;
    seen.reset({.resolution_m = f.map.geometry.resolution_m, .origin = {-64, -64, -32}, .size = {128, 128, 64}}, 2,
               f.now, 100ms);
    if (!was_seen) mark_box(&seen, {2.0, -9, -9}, {9, 9, 9}, 1, 1);
    SogmEncoder encoder;
    const auto send_seen = [&] {
      seen.start_utime = f.now;
      for (const sogm_t& part : encoder.encode(seen, make_header(kRobot, 1, f.now.time_since_epoch().count(), f.now)))
        f.send(channel::kSeenSpace, part);
    };
    send_seen();
    f.start({3.5, 0, 1});
    for (int i = 0; i < 10; ++i) {
      f.run_for(0.1);
      send_seen();
      f.send_map();
    }
    EXPECT_EQ(f.status().state, was_seen ? planner_status_t::kUnreachable : planner_status_t::kPlanning);
    EXPECT_LT(end_of(f.planned()).x(), 1.8) << "but no plan does";
    seen.reset(seen.geometry, 1, f.now, 100ms);
    send_seen();
    EXPECT_EQ(f.node.refused()[Refusal::kInconsistent], 1) << "one frame is no SEEN_SPACE";
  }
}

TEST(PlannerNode, SaysWhatItWaitsFor) {
  PlannerNodeConfig config = Fixture::make_config();
  config.planner.limits.space_max.z() = 3.0;
  Fixture f(config);
  const auto says = [&f] { return f.node.activity(f.now).text; };
  EXPECT_EQ(says(), "waits for SOGM");
  f.send_map();
  EXPECT_EQ(says(), "waits for OWN_TRAJECTORY");
  f.send_hover();
  EXPECT_EQ(says(), "waits for GOAL");
  EXPECT_TRUE(f.node.activity(f.now).waits);
  f.start({1, 0, 1});
  EXPECT_EQ(says(), "plans to [1,0,1]");
  EXPECT_FALSE(f.node.activity(f.now).waits);
  f.run_for(1.25);
  EXPECT_EQ(says(), "waits for SOGM");
  EXPECT_EQ(f.node.activity(f.now).detail.find("the last one is 1."), 0u) << f.node.activity(f.now).detail;
  Fixture above(config);
  above.start({1, 0, 4});
  EXPECT_EQ(above.node.activity(above.now).text, "plans, but no way leads to [1,0,4]");
  EXPECT_TRUE(above.node.activity(above.now).waits);
}

// Who is not heard may have stepped aside: the way past it leads farther off.
TEST(PlannerNode, KeepsFarFromSilentPeers) {
  double nearest[2] = {INFINITY, INFINITY};
  for (const bool silent : {false, true}) {
    Fixture f;
    const Eigen::Vector3d place(2.5, 0.3, 1);
    f.send_peer(7, Trajectory::hover(1, f.now, place));
    if (silent) f.run_for(0.6);
    f.start({5, 0, 1});
    const Trajectory plan = f.planned();
    for (Utime t = plan.start_utime(); t < plan.end_utime(); t += 10ms)
      nearest[silent] = std::min(nearest[silent], (plan.at(t).position - place).norm());
  }
  EXPECT_LT(nearest[0], 0.9);
  EXPECT_GT(nearest[1], nearest[0] + 0.3);
}

TEST(PlannerNode, DoesNotPlanWithStaleMaps) {
  Fixture f;
  f.send_hover();
  f.send_map(0.36);
  EXPECT_EQ(f.node.plans(), 0);
  f.run_for(1.0);
  EXPECT_EQ(f.node.plans(), 0);
  EXPECT_EQ(f.status().state, planner_status_t::kStaleMap);
  f.send_map(0.35);
  EXPECT_EQ(f.node.plans(), 1);
}

TEST(PlannerNode, FollowsTheGoal) {
  Fixture f;
  for (const Eigen::Vector3d& goal :
       {Eigen::Vector3d(1, 0, 1), Eigen::Vector3d(-0.5, 1.2, 1.4), Eigen::Vector3d(0, 0, 1.3)}) {
    f.send_hover();
    f.send_goal(goal);
    f.send_map();
    EXPECT_LT((end_of(f.planned()) - goal).norm(), 0.05) << goal.transpose();
    f.run_for(0.1);
  }
  f.send_goal({40, 0, 1});  // out of sight
  f.send_map();
  EXPECT_GT(end_of(f.planned()).x(), 2.0);
  EXPECT_EQ(f.node.plans(), 4);
}

TEST(PlannerNode, WithoutAGoalItHoldsItsPlaceButStepsAside) {
  Fixture f;
  f.send_hover();
  f.send_map();
  EXPECT_EQ(f.node.plans(), 1);
  EXPECT_EQ(f.out.count(channel::kCandidate), 0);  // it hovers there anyhow
  // A peer comes by, over the robot's place. Whatever is planned is committed.
  Motion peer{Trajectory::hover(1, f.now, {-2, 0, 1}), {}}, own{Trajectory::hover(1, f.now, kHome), {}};
  peer.next = quintic_to(peer.committed.at({}), f.now + 50ms, {2, 0, 1}, 3.0);
  double nearest = INFINITY;
  while (f.now < peer.end_utime()) {
    const int candidates = f.out.count(channel::kCandidate);
    f.send_peer(7, peer.committed, peer.next, announcement_t::kAnnounced);
    f.send_own(own);
    f.send_map();
    if (f.out.count(channel::kCandidate) > candidates) own.next = f.planned();
    for (int i = 0; i < 5; ++i) {
      f.run_for(0.01);
      nearest = std::min(nearest, (own.at(f.now).position - peer.at(f.now).position).norm());
    }
    if (!own.next.empty()) own = {own.next, {}};
  }
  EXPECT_GT(nearest, 0.4);
  EXPECT_LT((own.at(f.now).position - kHome).norm(), 0.1);  // and back it is
}

TEST(PlannerNode, KeepsClearOfPeersAndObstacles) {
  const Eigen::Vector3d goal(2, 0, 1), middle(1, 0, 1);
  Fixture alone, with_obstacle;
  alone.start(goal);
  const Trajectory straight = alone.planned();  // through the middle
  Utime middle_utime = straight.start_utime();
  while (straight.at(middle_utime).position.x() < middle.x()) middle_utime += 10ms;
  with_obstacle.occupy(middle - Eigen::Vector3d(0.2, 0.2, 5), middle + Eigen::Vector3d(0.2, 0.2, 5));
  with_obstacle.start(goal);
  const Trajectory around = with_obstacle.planned();
  for (Utime t = around.start_utime(); t <= around.end_utime(); t += 10ms) {
    EXPECT_GT((around.at(t).position - middle).norm(), 0.4);
  }
  // A peer that stands in the middle; one that will be there at the same time, bound to it or not yet.
  const Motion stands{Trajectory::hover(1, kStart, middle), {}};
  Motion crosses{Trajectory::hover(1, kStart, {1, -1.5, 1}), {}};
  const Utime leaves = kStart + 10ms;
  crosses.next = quintic_to(crosses.committed.at({}), leaves, {1, 1.5, 1}, 2 * to_seconds(middle_utime - leaves));
  for (const std::int8_t state : {announcement_t::kNone, announcement_t::kAnnounced, announcement_t::kCommitted}) {
    SCOPED_TRACE(static_cast<int>(state));
    const Motion& theirs = state == announcement_t::kNone ? stands : crosses;
    Fixture f;
    f.send_peer(1, theirs.committed, theirs.next, state);
    f.start(goal);
    const Trajectory planned = f.planned();
    EXPECT_TRUE(motions_separated({planned, {}}, theirs, planned.start_utime(), 0.42));
    EXPECT_FALSE(motions_separated({straight, {}}, theirs, planned.start_utime(), 0.42));
  }
}

TEST(PlannerNode, PublishesTheCorridorsOfItsPlan) {
  Fixture f;
  f.occupy({0.8, -0.2, -1}, {1.2, 0.2, 3});
  f.start({2, 0, 1});
  const auto corridors = f.out.newest<corridors_t>(channel::kCorridors);
  const auto candidate = f.out.newest<candidate_t>(channel::kCandidate);
  const Trajectory planned = f.planned();
  EXPECT_EQ(corridors.trajectory_seq, candidate.trajectory.seq);
  EXPECT_EQ(f.status().outcome, planner_status_t::kSmooth);
  std::vector<int> faces(static_cast<std::size_t>(planned.num_pieces()), 0);
  for (const auto& face : corridors.faces) {
    ASSERT_LT(face.piece, planned.num_pieces());
    ++faces[static_cast<std::size_t>(face.piece)];
    const Eigen::Vector3d normal = Eigen::Vector3f(face.normal).cast<double>();
    for (int k = 0; k <= 20; ++k) {
      const Utime t = planned.start_utime() + face.piece * planned.piece() + k * planned.piece() / 20;
      EXPECT_LE(normal.dot(planned.at(t).position), face.offset + 1e-3) << "piece " << face.piece << ", " << k;
    }
  }
  for (const int count : faces) EXPECT_GE(count, 4);  // fewer do not bound anything
}

TEST(PlannerNode, TakesMapsInSeveralParts) {
  Fixture f;
  std::mt19937_64 random(1);
  for (int frame = 0; frame < f.map.num_frames; ++frame) {  // noise that does not compress, behind the robot
    for (int x = 0; x < 30; ++x) {
      for (int y = 0; y < 100; ++y) *f.map.column(frame, x, y) = random() & ((std::uint64_t{1} << 40) - 1);
    }
  }
  f.send_hover();
  f.send_goal({1, 0, 1});
  const std::vector<sogm_t> parts = f.map_parts();
  ASSERT_GE(parts.size(), 4u);
  for (std::size_t i = parts.size(); i-- > 0;) {
    EXPECT_EQ(f.node.plans(), 0);
    f.send(channel::kSogm, parts[i]);
    f.run_for(0.001);
  }
  EXPECT_EQ(f.node.plans(), 1);
  EXPECT_LT((end_of(f.planned()) - Eigen::Vector3d(1, 0, 1)).norm(), 0.05);
  const std::vector<sogm_t> incomplete = f.map_parts();
  f.run_for(0.05);
  for (std::size_t i = 1; i < incomplete.size(); ++i) f.send(channel::kSogm, incomplete[i]);
  EXPECT_EQ(f.node.plans(), 1);
  f.send_map();
  EXPECT_EQ(f.node.plans(), 2);
  EXPECT_EQ(f.node.refused().total(), 0);
}

TEST(PlannerNode, DurationsArePublishedOrZero) {
  for (const bool publish : {true, false}) {
    std::chrono::nanoseconds ns{};
    Fixture f(
        Fixture::make_config(), [&ns] { return ns += 2ms; }, publish);
    f.start({1, 0, 1});
    f.run_for(0.05);
    f.send_map();
    f.run_for(0.001);
    const planner_status_t status = f.status();
    for (const float ms :
         {status.compose_ms, status.search_ms, status.corridor_ms, status.optimize_ms, status.check_ms}) {
      EXPECT_EQ(ms, publish ? 2.0f : 0.0f);
    }
    EXPECT_EQ(status.total_ms, publish ? 10.0f : 0.0f);
    EXPECT_EQ(f.node.newest_plan().step_ms[0], 2.0);
    // Where durations count, ways are worked out for themselves, and the plan comes after the next.
    EXPECT_EQ(f.node.newest_plan().prepare_ms, publish ? 4.0 : 2.0);
    EXPECT_GT(status.expansions, 0);
  }
}

TEST(PlannerNode, RefusalsAreCountedAndChangeNothing) {
  Fixture f, untouched;
  for (Fixture* each : {&f, &untouched}) each->start({1.5, 0.5, 1});
  std::array<int, kNumRefusals> expected{};
  const auto expect_refused = [&](Refusal reason, const char* channel, const Bytes& bytes) {
    f.deliver(BusId::kOnboard, channel, bytes);
    ++expected[static_cast<std::size_t>(reason)];
    for (int i = 0; i < kNumRefusals; ++i) {
      ASSERT_EQ(f.node.refused()[static_cast<Refusal>(i)], expected[static_cast<std::size_t>(i)])
          << channel << ", " << to_string(reason) << " expected, " << to_string(static_cast<Refusal>(i)) << " counted";
    }
  };
  const auto refuse_each = [&](const char* channel, const auto& message, bool timed, int wrong_robot) {
    const auto changed = [&](const auto& change) {
      auto copy = message;
      change(copy);
      return encoded(copy);
    };
    Bytes damaged = encoded(message);
    damaged[damaged.size() / 2] ^= 1;
    expect_refused(Refusal::kSize, channel, {});
    expect_refused(Refusal::kFingerprint, channel, Bytes(damaged.size(), 0x5a));
    expect_refused(Refusal::kCrc, channel, damaged);
    expect_refused(Refusal::kVersion, channel, changed([](auto& m) { ++m.header.schema_version; }));
    expect_refused(Refusal::kRobot, channel,
                   changed([&](auto& m) { m.header.robot_id = static_cast<std::int16_t>(wrong_robot); }));
    if (!timed) return;
    expect_refused(Refusal::kTime, channel, changed([](auto& m) { m.header.utime -= 1'000'001; }));
    expect_refused(Refusal::kTime, channel, changed([](auto& m) { m.header.utime += 100'001; }));
  };
  const Trajectory elsewhere = Trajectory::hover(4, f.now, {0.5, 0.2, 1});
  goal_t goal = to_goal({{{-3, 0, 0}}});
  goal.header = make_header(kRobot, 1, 50, f.now);
  std::ranges::fill(f.map.words_to_write(), 0);
  f.occupy({0.4, -5, -1}, {0.6, 5, 3});
  const std::vector<sogm_t> wall = f.map_parts();
  ASSERT_EQ(wall.size(), 1u);
  refuse_each(channel::kSogm, wall[0], true, kRobot + 1);
  refuse_each(channel::kGoal, goal, false, kRobot + 1);
  refuse_each(channel::kOwnTrajectory, f.announcement(kRobot, elsewhere, {}, 0), false, kRobot + 1);
  refuse_each(channel::kPeerTrajectory, f.announcement(1, elsewhere, {}, 0), true, kRobot);
  goal.header.seq = 0;
  expect_refused(Refusal::kSequence, channel::kGoal, encoded(goal));
  goal.waypoints[0].position[0] = INFINITY;
  expect_refused(Refusal::kValue, channel::kGoal, encoded(goal));
  f.deliver(BusId::kOnboard, "OTHER", Bytes(100, 1));

  for (Fixture* each : {&f, &untouched}) each->run_for(0.1);
  std::ranges::fill(f.map.words_to_write(), 0);
  for (Fixture* each : {&f, &untouched}) each->send_map();
  EXPECT_EQ(f.node.plans(), 2);
  EXPECT_EQ(encoded(f.out.newest<candidate_t>(channel::kCandidate)),
            encoded(untouched.out.newest<candidate_t>(channel::kCandidate)));
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), f.status().refused));
}

TEST(PlannerNode, BeforeTheFirstPlanTheNewestIsNone) {
  const Fixture f;
  EXPECT_TRUE(f.node.newest_plan().trajectory.empty());
  EXPECT_FALSE(f.node.newest_plan().fly);
  EXPECT_EQ(f.node.newest_plan().expansions, 0);
}

TEST(PlannerNode, AClockThatIsSetStopsNeitherPlansNorStatuses) {
  for (const Duration step : {-5s, 10s}) {
    SCOPED_TRACE(step.count());
    Fixture f;
    const auto plan_for = [&f](double seconds) {
      for (int i = 0; i < std::lround(20 * seconds); ++i) {
        f.send_hover();
        f.send_map();
        f.run_for(0.05);
      }
    };
    f.start({3, 0, 1});
    f.send_peer(1, Trajectory::hover(1, f.now, {5, 5, 1}));
    plan_for(1.0);
    const int plans = f.node.plans(), maps = f.node.missed() + plans;
    f.now += step;
    f.step();
    EXPECT_EQ(f.node.plans(), plans);  // with a map of another time
    f.run_for(3.0);
    EXPECT_EQ(f.node.plans(), plans);
    EXPECT_EQ(f.status().state, planner_status_t::kStaleMap);
    EXPECT_GE(f.out.count(channel::kPlannerStatus), plans + 3);
    f.send_goal({3, 0.1, 1});
    plan_for(1.0);
    EXPECT_GE(f.node.plans(), plans + 19);
    EXPECT_EQ(f.node.missed() + f.node.plans(), maps + 20);
    EXPECT_LE(f.status().rate_hz, 21.0f);
    EXPECT_TRUE(f.node.newest_request().peers->at(0).silent);
  }
}

TEST(PlannerNode, WhenTheClockIsSetAllThatItKnowsMoves) {
  for (const Duration step : {-5s, 5s}) {
    Fixture f;
    f.start({3, 0, 1});
    f.send_peer(1, Trajectory::hover(1, f.now, {5, 5, 1}));
    ASSERT_EQ(f.node.plans(), 1);
    f.run_for(0.01);
    f.send_map();
    ASSERT_EQ(f.node.plans(), 1);  // not before the period is over
    f.wall_ahead = step;
    f.step();
    f.run_for(0.04);
    EXPECT_EQ(f.node.plans(), 2);  // with that map
    EXPECT_FALSE(f.node.newest_request().peers->at(0).silent);
  }
}

// A budget that would take a gigabyte is a slip of the pen.
TEST(PlannerNodeConfig, TheBudgetIsBounded) {
  const auto parse = [](const char* budget) {
    PlannerNodeConfig config;
    OptionSet options("planner_daemon", "");
    declare(options, config);
    const char* arguments[] = {"", "--max-expansions", budget};
    std::ostringstream out;
    (void)options.parse(3, arguments, out);
  };
  EXPECT_NO_THROW(parse("5000"));
  EXPECT_THROW(parse("5001"), OptionError);
}

TEST(PlannerNodeConfig, ImpossibleCombinationsAreRefusedByName) {
  const auto complaint = [](const std::function<void(PlannerNodeConfig&)>& change) -> std::string {
    PlannerNodeConfig config = Fixture::make_config();
    change(config);
    try {
      PlannerNode node(config, 1, nullptr);
    } catch (const OptionError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(complaint([](PlannerNodeConfig&) {}), "");
  const auto names = [](const std::string& text, const char* name) { return text.find(name) != std::string::npos; };
  EXPECT_TRUE(names(complaint([](auto& c) { c.planner.limits.space_min.z() = 3.8; }), "space-min"));
  EXPECT_TRUE(names(complaint([](auto& c) { c.planner.space.emergency_clearance_m = 0.2; }), "emergency-clearance"));
  EXPECT_TRUE(names(complaint([](auto& c) { c.planner.search.num_pieces = 2; }), "pieces"));
  EXPECT_TRUE(names(complaint([](auto& c) { c.planner.search.piece = 801ms; }), "8.01 s in all; must be at most 8 s"));
}

// In cells peers come and go; by a roster who is silent is where it was bound to be.
TEST(PlannerNode, ForgetsPeersThatFlewElsewhere) {
  for (const bool is_in_cells : {false, true}) {
    SCOPED_TRACE(is_in_cells);
    PlannerNodeFixture f;
    f.num_acks = is_in_cells ? 0 : 2;
    f.start({2, 0, 1});
    f.send_peer(4, Trajectory::hover(1, f.now, {1, 1, 1}));
    f.send_peer(5, Trajectory::hover(1, f.now, {1, -1, 1}));
    f.run_for(2.0);
    f.send_peer(5, Trajectory::hover(2, f.now, {1, -1, 1}));
    f.run_for(2.0);
    f.send_hover();
    f.send_map();
    const std::vector<Peer>& peers = *f.node.newest_request().peers;
    ASSERT_EQ(peers.size(), is_in_cells ? 1u : 2u);
    EXPECT_EQ(peers.back().id, 5);
    f.send_peer(5, Trajectory::hover(3, f.now, {1, -2, 1}));
    f.send_peer(4, Trajectory::hover(2, f.now, {1, 2, 1}));
    EXPECT_EQ(peers.size(), 2u);
    for (const Peer& peer : peers) EXPECT_EQ(peer.motion.at(f.now).position.y(), peer.id == 4 ? 2 : -2);
    // One that was expelled is shown again and again.
    announcement_t tombstone = f.announcement(6, Trajectory::hover(1, f.now, {3, 3, 1}), {}, announcement_t::kNone);
    for (int i = 0; i < 10; ++i) {
      tombstone.header.utime = to_us(f.now);
      f.send(channel::kPeerTrajectory, tombstone);
      f.run_for(0.5);
    }
    f.send_hover();
    f.send_map();
    EXPECT_EQ(peers.size(), is_in_cells ? 1u : 3u);
    EXPECT_EQ(peers.back().id, 6);
  }
}

}  // namespace
}  // namespace swarm::test
