// The map daemon's node: when it publishes, what it publishes, and what it makes of bad input. Long because
// every message and every limit of its configuration is refused once.
#include "map_daemon/map_node.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <sstream>
#include <string>

#include "lcmtypes/bus/channels.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using sogm_swarm::map_status_t;
using sogm_swarm::obstacle_t;
using sogm_swarm::obstacle_voxels_t;
using sogm_swarm::obstacles_t;
using sogm_swarm::robot_state_t;

constexpr int kRobot = 4;

class Inbox : public Outbox {
 public:
  void publish_bytes(BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) override {
    EXPECT_EQ(bus, BusId::kOnboard);
    if (channel == channel::kSogm) {
      sogm_swarm::sogm_t part;
      ASSERT_EQ(decode(bytes, &part), Refusal::kNone);
      const Assembly assembly = assembler_.add(part, &map);
      ASSERT_NE(assembly.status, AssemblyStatus::kRefused) << to_string(assembly.refusal);
      maps += assembly.status == AssemblyStatus::kComplete;
    } else {
      ASSERT_EQ(channel, channel::kMapStatus);
      ASSERT_EQ(decode(bytes, &status), Refusal::kNone);
      ++statuses;
    }
  }

  Sogm map;
  map_status_t status{};
  int maps = 0, statuses = 0;

 private:
  SogmAssembler assembler_;
};

// A node in simulated time that is called as the hosts call it.
class Fixture {
 public:
  explicit Fixture(const MapConfig& config = default_config(), Stopwatch stopwatch = nullptr)
      : node(config, 77, std::move(stopwatch)) {
    wake_ = node.step(now, out);
  }

  static MapConfig default_config() {
    MapConfig config;
    config.max_rate_hz = 20.0;
    config.robot_id = kRobot;
    return config;
  }

  // Wakes the node whenever it asked for it.
  void run_until(Utime utime) {
    while (wake_ <= utime) {
      ASSERT_GT(wake_, now);
      now = wake_;
      wake_ = node.step(now, out);
    }
    now = utime;
  }
  void set_clock(Duration step) {
    ASSERT_TRUE(node.on_clock_step(now, step));
    now += step;
    wake_ = node.step(now, out);
  }
  void run_for(double seconds) { run_until(now + to_duration(seconds)); }

  void deliver(const char* channel, std::span<const std::uint8_t> bytes) {
    node.on_message(now, BusId::kOnboard, channel, bytes, out);
    wake_ = node.step(now, out);
  }
  template <class T>
  void send(const char* channel, const T& message) {
    encode(message, &bytes_);
    deliver(channel, bytes_);
  }

  template <class T>
  T message() {
    T message{};
    message.header.schema_version = sogm_swarm::header_t::kSchemaVersion;
    message.header.robot_id = kRobot;
    message.header.boot = 1;
    message.header.seq = seq_++;
    message.header.utime = to_us(now);
    return message;
  }
  void send_state(const Eigen::Vector3d& position = {0, 0, 1}, const Eigen::Vector3d& velocity = {0, 0, 0}) {
    auto state = message<robot_state_t>();
    Eigen::Map<Eigen::Vector3d>(state.position) = position;
    Eigen::Map<Eigen::Vector3d>(state.velocity) = velocity;
    send(channel::kRobotState, state);
  }
  // Until the first map, which waits for obstacles for a while.
  void start(const Eigen::Vector3d& position = {0, 0, 1}, const Eigen::Vector3d& velocity = {0, 0, 0}) {
    send_state(position, velocity);
    EXPECT_EQ(out.maps, 0);
    run_for(0.05);
    EXPECT_EQ(out.maps, 1);
  }
  obstacles_t one_sphere(const Eigen::Vector3d& position, const Eigen::Vector3d& velocity = {0, 0, 0}) {
    auto list = message<obstacles_t>();
    obstacle_t sphere{};
    sphere.shape = obstacle_t::kSphere;
    sphere.size[0] = 0.4;
    Eigen::Map<Eigen::Vector3d>(sphere.position) = position;
    Eigen::Map<Eigen::Vector3d>(sphere.velocity) = velocity;
    list.obstacles = {sphere};
    list.num_obstacles = 1;
    return list;
  }
  bool occupied(double since_s, const Eigen::Vector3d& point) const {
    const Sogm& map = out.map;
    return map.occupied(map.frame_at(map.start_utime + to_duration(since_s)), map.geometry.voxel_of(point));
  }
  bool empty() const {
    return std::all_of(out.map.words().begin(), out.map.words().end(), [](std::uint64_t word) { return word == 0; });
  }

  Utime now = kStart;
  Inbox out;
  MapNode node;

 private:
  Utime wake_{};
  std::int64_t seq_ = 0;
  std::vector<std::uint8_t> bytes_;
};

TEST(MapNode, NoMapsWithoutState) {
  Fixture f;
  f.send(channel::kObstacles, f.one_sphere({1, 0, 1}));
  f.run_for(3.5);
  EXPECT_EQ(f.out.maps, 0);
  EXPECT_EQ(f.out.statuses, 4);
  EXPECT_EQ(f.out.status.state, map_status_t::kNoState);
  f.send_state();
  EXPECT_EQ(f.out.maps, 1);  // at once
}

TEST(MapNode, SaysWhatItWaitsFor) {
  Fixture f;
  EXPECT_EQ(f.node.activity(f.now).text, "waits for ROBOT_STATE");
  f.send_state();
  EXPECT_EQ(f.node.activity(f.now).text, "makes maps around the robot");
  EXPECT_FALSE(f.node.activity(f.now).waits);
  f.run_for(2.0);
  EXPECT_EQ(f.node.activity(f.now).text, "waits for ROBOT_STATE");
  EXPECT_EQ(f.node.activity(f.now).detail, "the last one is 2.0 s old");
  EXPECT_TRUE(f.node.activity(f.now).waits);
}

// Space as a perception daemon saw it: all of it free but what is named, W.
struct SeenSpace {
  explicit SeenSpace(Utime utime) {
    space.reset({.resolution_m = 0.1, .origin = {-64, -64, -22}, .size = {128, 128, 64}}, 2, utime, 100ms);
  }
  void set(int frame, const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
    const Eigen::Vector3i first = space.geometry.voxel_of(low), last = space.geometry.voxel_of(high);
    for (int x = first.x(); x <= last.x(); ++x)
      for (int y = first.y(); y <= last.y(); ++y) set_run(first.z(), last.z(), 64, space.column(frame, x, y));
  }
  void send(Fixture* f) {
    SogmEncoder encoder;
    for (const sogm_swarm::sogm_t& part : encoder.encode(space, f->message<robot_state_t>().header))
      f->send(channel::kSeenSpace, part);
  }
  Sogm space;
};

MapConfig seeing(const std::string& unknown) {
  MapConfig config = Fixture::default_config();
  config.perception = true;
  config.unknown = unknown;
  return config;
}

TEST(MapNode, WhatWasSeenToStandIsInEveryFrame) {
  Fixture f(seeing("free"));
  SeenSpace seen(f.now);
  seen.set(0, {2.05, -1.0, 0.05}, {2.05, 1.0, 2.0});
  f.send_state();
  seen.send(&f);
  ASSERT_EQ(f.out.maps, 1);
  for (const double since_s : {0.0, 1.9}) {
    EXPECT_TRUE(f.occupied(since_s, {2.05, 0.5, 1.0}));
    EXPECT_FALSE(f.occupied(since_s, {1.85, 0.5, 1.0}));
  }
}

TEST(MapNode, WithoutEyesThereAreNoMaps) {
  Fixture f(seeing("near"));
  f.send_state();
  f.run_for(0.4);
  EXPECT_EQ(f.out.maps, 0);
  EXPECT_EQ(f.node.activity(f.now).text, "waits for SEEN_SPACE");
  f.send_state();
  SeenSpace(f.now).send(&f);
  EXPECT_EQ(f.out.maps, 1);
  f.run_for(0.29);
  const int maps = f.out.maps;
  EXPECT_GT(maps, 2);
  f.run_for(1.0);
  EXPECT_LE(f.out.maps, maps + 1);
  EXPECT_EQ(f.out.status.state, map_status_t::kStaleState) << "nor a state";
  f.send_state();
  f.run_for(0.49);
  EXPECT_LE(f.out.maps, maps + 1);
  EXPECT_TRUE(f.node.activity(f.now).waits);
}

// Within 1.5 m, but not just beside what was seen.
TEST(MapNode, UnknownSpaceIsOccupiedWhereItIsNear) {
  for (const std::string policy : {"free", "near", "occupied"}) {
    SCOPED_TRACE(policy);
    Fixture f(seeing(policy));
    SeenSpace seen(f.now);
    seen.set(1, {-6.4, -6.4, 1.35}, {6.3, 6.3, 4.1});  // nothing was seen above
    f.send_state({0, 0, 1});
    seen.send(&f);
    EXPECT_EQ(f.occupied(0.0, {0.05, 0.05, 2.05}), policy != "free");
    EXPECT_EQ(f.occupied(1.9, {0.85, 0.05, 1.75}), policy != "free");
    EXPECT_EQ(f.occupied(0.0, {2.05, 0.05, 2.05}), policy == "occupied") << "far";
    EXPECT_EQ(f.occupied(0.0, {0.05, 0.05, 1.65}), policy != "free");
    EXPECT_EQ(f.occupied(0.0, {0.85, 0.05, 1.45}), policy != "free") << "just above what was seen";
    EXPECT_FALSE(f.occupied(0.0, {0.85, 0.05, 1.25})) << "seen";
  }
}

// Who knows all that stands may sink to where nobody looked.
TEST(MapNode, WhoKnowsTheBuildingTakesWhatIsBelowSeenSpaceForFree) {
  for (const bool explores : {true, false}) {
    MapConfig config = seeing("near");
    config.explores = explores;
    Fixture f(config);
    SeenSpace seen(f.now);
    seen.set(1, {-6.4, -6.4, -2.0}, {6.3, 6.3, 0.75});  // nothing was seen below
    f.send_state({0, 0, 1});
    seen.send(&f);
    EXPECT_EQ(f.occupied(0.0, {0.85, 0.05, 0.65}), explores);
    EXPECT_TRUE(f.occupied(0.0, {0.85, 0.05, 0.35}));
    EXPECT_FALSE(f.occupied(0.0, {0.85, 0.05, 0.95}));
  }
}

TEST(MapNode, JustBesideWhatWasSeenItIsFree) {
  Fixture f(seeing("near"));
  SeenSpace seen(f.now);
  seen.set(1, {0.75, -6.4, 0.0}, {6.3, 6.3, 4.1});  // nothing was seen ahead
  f.send_state({0, 0, 1});
  seen.send(&f);
  EXPECT_FALSE(f.occupied(0.0, {0.65, 0.05, 1.05})) << "seen";
  EXPECT_FALSE(f.occupied(0.0, {0.85, 0.05, 1.05})) << "beside";
  EXPECT_TRUE(f.occupied(0.0, {1.15, 0.05, 1.05}));
}

TEST(MapNode, SpaceOfOtherVoxelsOrFramesIsRefused) {
  Fixture f(seeing("near"));
  f.send_state();
  SeenSpace coarse(f.now), single(f.now);
  coarse.space.reset({.resolution_m = 0.2, .size = {64, 64, 32}}, 2, f.now, 100ms);
  coarse.send(&f);
  EXPECT_EQ(f.node.refused()[Refusal::kInconsistent], 1);
  single.space.reset(single.space.geometry, 1, f.now, 100ms);
  single.send(&f);
  EXPECT_EQ(f.node.refused()[Refusal::kInconsistent], 2);
  EXPECT_EQ(f.out.maps, 0);
}

TEST(MapNode, FirstMapWaitsForObstaclesButNotLong) {
  Fixture with_obstacles, without;
  with_obstacles.send_state();
  without.send_state();
  with_obstacles.run_for(0.02);
  EXPECT_EQ(with_obstacles.out.maps, 0);
  with_obstacles.send(channel::kObstacles, with_obstacles.one_sphere({1, 0, 1}));
  EXPECT_EQ(with_obstacles.out.maps, 1);
  without.run_for(0.049);
  EXPECT_EQ(without.out.maps, 0);
  without.run_for(0.001);
  EXPECT_EQ(without.out.maps, 1);
}

TEST(MapNode, StaleStateStopsMapsUntilTheNextState) {
  Fixture f;
  f.send_state();
  f.run_for(2.0);
  EXPECT_EQ(f.out.maps, 5);  // at 0.05, 0.15 ... 0.45 s
  EXPECT_EQ(f.out.status.state, map_status_t::kStaleState);
  f.send_state();
  EXPECT_EQ(f.out.maps, 6);
  f.run_for(0.1);
  EXPECT_EQ(f.out.maps, 7);
}

TEST(MapNode, PublishesAtTheLeastRateAndReportsIt) {
  Fixture f;
  for (int i = 0; i < 31; ++i) {
    f.send_state();
    f.run_for(0.1);
  }
  EXPECT_EQ(f.out.maps, 31);
  EXPECT_EQ(f.out.status.state, map_status_t::kRunning);
  EXPECT_NEAR(f.out.status.rate_hz, 10.0, 1e-6);
  EXPECT_EQ(f.out.status.build_ms, 0.0f);
  EXPECT_GT(f.out.status.map_bytes, 0);
  EXPECT_EQ(f.out.status.header.robot_id, kRobot);
  EXPECT_EQ(f.out.status.header.boot, 77);
}

TEST(MapNode, PublishesAtOnceOnObstaclesUpToTheHighestRate) {
  Fixture f;
  f.start();
  f.run_for(0.07);
  EXPECT_EQ(f.out.maps, 1);
  f.send(channel::kObstacles, f.one_sphere({1, 0, 1}));
  EXPECT_EQ(f.out.maps, 2);
  EXPECT_EQ(f.out.map.start_utime, f.now);
  EXPECT_TRUE(f.occupied(0, {1, 0, 1}));
  f.run_for(0.01);
  f.send(channel::kObstacles, f.one_sphere({2, 0, 1}));  // too early: waits for 50 ms since the map before
  EXPECT_EQ(f.out.maps, 2);
  f.run_for(0.039);
  EXPECT_EQ(f.out.maps, 2);
  f.run_for(0.001);
  EXPECT_EQ(f.out.maps, 3);
  EXPECT_TRUE(f.occupied(0, {2, 0, 1}));
  EXPECT_FALSE(f.occupied(0, {1, 0, 1}));
  const int before = f.out.maps;
  for (int i = 0; i < 100; ++i) {  // 100 Hz of obstacles for a second
    if (i % 20 == 0) f.send_state();
    f.send(channel::kObstacles, f.one_sphere({2, 0, 1}));
    f.run_for(0.01);
  }
  EXPECT_NEAR(f.out.maps - before, 20, 1);
}

TEST(MapNode, ObstaclesAtTwentyHertzNeverWaitForTheirMap) {
  MapConfig config;
  config.robot_id = kRobot;
  Fixture f(config);
  f.send_state();
  f.run_for(0.09);
  for (int i = 0; i < 20; ++i) {
    if (i % 5 == 0) f.send_state();
    f.send(channel::kObstacles, f.one_sphere({1, 0, 1}));
    EXPECT_TRUE(i == 0 || f.out.map.start_utime == f.now) << "list " << i;
    f.run_for(0.05);
  }
}

TEST(MapNode, WindowFollowsThePredictedRobotOnTheLattice) {
  Fixture f;
  f.start({1.234, -20.5, 3.01}, {2.0, -1.0, 0.5});
  f.run_for(0.1);
  ASSERT_EQ(f.out.maps, 2);
  const GridGeometry& g = f.out.map.geometry;
  EXPECT_EQ(g.size, Eigen::Vector3i(100, 100, 40));
  const Eigen::Vector3d middle = (g.origin.cast<double>() + g.size.cast<double>() / 2) * g.resolution_m;
  EXPECT_LE((middle - Eigen::Vector3d(1.534, -20.65, 3.085)).cwiseAbs().maxCoeff(), 0.05 + 1e-9) << middle.transpose();
  EXPECT_EQ(f.out.map.num_frames, 20);
  EXPECT_EQ(f.out.map.frame_duration, 100ms);
}

TEST(MapNode, ObstaclesMoveFromTheirMeasurementOn) {
  Fixture f;
  f.start();
  f.run_for(0.15);
  auto list = f.one_sphere({-2, 0, 1}, {1, 0, 0});
  list.obstacles[0].age_s = 0.5;
  list.header.utime -= 100'000;  // measured 0.6 s ago: now at -1.4
  f.send(channel::kObstacles, list);
  ASSERT_EQ(f.out.maps, 3);
  EXPECT_TRUE(f.occupied(0.0, {-1.4, 0, 1}));
  EXPECT_FALSE(f.occupied(0.0, {-2.0, 0, 1}));
  EXPECT_TRUE(f.occupied(1.0, {-0.4, 0, 1}));
  EXPECT_FALSE(f.occupied(1.0, {-1.4, 0, 1}));
  EXPECT_TRUE(f.occupied(1.95, {0.6, 0, 1}));
}

TEST(MapNode, ShapesOfTheWireMeanTheSameHere) {
  Fixture f;
  f.start();
  auto list = f.message<obstacles_t>();
  const auto add = [&](std::int16_t shape, const Eigen::Vector3d& position, const Eigen::Vector3d& size, double yaw) {
    obstacle_t obstacle{};
    obstacle.shape = shape;
    obstacle.yaw = yaw;
    Eigen::Map<Eigen::Vector3d>(obstacle.position) = position;
    Eigen::Map<Eigen::Vector3d>(obstacle.size) = size;
    list.obstacles.push_back(obstacle);
    ++list.num_obstacles;
  };
  f.run_for(0.06);
  list.header.utime = to_us(f.now);
  add(obstacle_t::kColumn, {-3, -3, 1}, {0.6, 2.0, 0}, 0);
  add(obstacle_t::kRing, {3, 3, 1}, {1.0, 0.1, 0}, 0);  // axis along x
  add(obstacle_t::kBox, {-3, 3, 1}, {2.0, 0.2, 0.2}, 1.5707963);
  add(obstacle_t::kSphere, {3, -3, 1}, {1.0, 0, 0}, 0);
  f.send(channel::kObstacles, list);
  ASSERT_EQ(f.out.maps, 2);
  EXPECT_TRUE(f.occupied(0, {-3, -3, 1.95}));
  EXPECT_FALSE(f.occupied(0, {-3, -3, 2.2}));
  EXPECT_TRUE(f.occupied(0, {3, 4, 1}));
  EXPECT_TRUE(f.occupied(0, {3, 3, 2}));
  EXPECT_FALSE(f.occupied(0, {3, 3, 1}));
  EXPECT_TRUE(f.occupied(0, {-3, 3.9, 1}));
  EXPECT_FALSE(f.occupied(0, {-2.2, 3, 1}));
  EXPECT_TRUE(f.occupied(0, {3, -3.4, 1}));
  f.run_for(0.95);
  EXPECT_EQ(f.out.status.obstacles, 4);
}

TEST(MapNode, VoxelObstaclesAreKeptPerIdAndForgotten) {
  Fixture f;
  const auto voxels = [&](int id, const Eigen::Vector3d& position) {
    auto message = f.message<obstacle_voxels_t>();
    message.id = id;
    Eigen::Map<Eigen::Vector3d>(message.position) = position;
    message.resolution = 0.2;
    message.voxels = {{0, 0, 2}, {0, 0, 0}, {0, 0, 1}, {3, 0, 0}, {0, 0, 1}};
    message.num_voxels = 5;
    return message;
  };
  f.start();
  f.run_for(0.05);
  f.send(channel::kObstacleVoxels, voxels(1, {1, 0, 1}));
  f.run_for(0.05);
  f.send(channel::kObstacleVoxels, voxels(2, {-1, 0, 1}));
  EXPECT_EQ(f.out.maps, 3);
  for (double x : {1.0, -1.0}) {
    EXPECT_TRUE(f.occupied(0, {x, 0, 1.4}));
    EXPECT_TRUE(f.occupied(0, {x + 0.6, 0, 1.0}));
    EXPECT_FALSE(f.occupied(0, {x + 0.3, 0, 1.0}));
  }
  f.run_for(0.05);
  f.send(channel::kObstacleVoxels, voxels(1, {2, 0, 1}));
  EXPECT_FALSE(f.occupied(0, {1, 0, 1.4}));
  EXPECT_TRUE(f.occupied(0, {2, 0, 1.4}));
  for (int i = 0; i < 12; ++i) {
    f.send_state();
    f.send(channel::kObstacleVoxels, voxels(2, {-1, 0, 1}));
    f.run_for(0.1);
  }
  EXPECT_FALSE(f.occupied(0, {2, 0, 1.4}));  // no longer reported
  EXPECT_TRUE(f.occupied(0, {-1, 0, 1.4}));
}

TEST(MapNode, ListIsReplacedAndForgottenWhenReportsStop) {
  Fixture f;
  f.start();
  f.run_for(0.05);
  auto old = f.one_sphere({1, 0, 1});
  old.obstacles[0].age_s = 20.0;  // old, but still reported
  f.send(channel::kObstacles, old);
  EXPECT_TRUE(f.occupied(0, {1, 0, 1}));
  for (int i = 0; i < 9; ++i) {
    f.run_for(0.1);
    f.send_state();
  }
  EXPECT_TRUE(f.occupied(0, {1, 0, 1}));
  f.run_for(0.2);
  EXPECT_TRUE(f.empty());
}

TEST(MapNode, BadMessagesAreCountedAndChangeNothing) {
  Fixture f;
  f.start();
  f.run_for(0.06);
  f.send(channel::kObstacles, f.one_sphere({1, 0, 1}));
  const Sogm before = f.out.map;
  ASSERT_EQ(f.out.maps, 2);
  int refused = 0;
  const auto expect_refused = [&](Refusal reason, const std::function<void()>& send) {
    const std::int32_t count = f.node.refused()[reason];
    send();
    EXPECT_EQ(f.node.refused()[reason], count + 1) << to_string(reason);
    EXPECT_EQ(f.node.refused().total(), ++refused) << to_string(reason);
  };
  const std::vector<std::uint8_t> garbage(300, 0x5a);
  for (const char* channel : {channel::kRobotState, channel::kObstacles, channel::kObstacleVoxels}) {
    expect_refused(Refusal::kSize, [&] { f.deliver(channel, {}); });
    expect_refused(Refusal::kFingerprint, [&] { f.deliver(channel, garbage); });
  }
  const auto with_state = [&](const auto& change) {
    return [&f, change] {
      auto state = f.message<robot_state_t>();
      change(state);
      f.send(channel::kRobotState, state);
    };
  };
  const auto with_obstacles = [&](const auto& change) {
    return [&f, change] {
      auto list = f.one_sphere({2, 2, 1});
      change(list);
      f.send(channel::kObstacles, list);
    };
  };
  const auto with_voxels = [&](const auto& change) {
    return [&f, change] {
      auto message = f.message<obstacle_voxels_t>();
      message.resolution = 0.1;
      change(message);
      f.send(channel::kObstacleVoxels, message);
    };
  };
  const auto wrong_robot = [](auto& message) { ++message.header.robot_id; };
  const auto late = [](auto& message) { message.header.utime -= 1'100'000; };
  const auto early = [](auto& message) { message.header.utime += 150'000; };
  const auto wrong_version = [](auto& message) { ++message.header.schema_version; };
  const auto endless = [](auto& message) { message.position[0] = std::numeric_limits<double>::infinity(); };
  const auto for_each_input = [&](Refusal reason, const auto& change) {
    expect_refused(reason, with_state(change));
    expect_refused(reason, with_obstacles(change));
    expect_refused(reason, with_voxels(change));
  };
  for_each_input(Refusal::kRobot, wrong_robot);
  for_each_input(Refusal::kTime, late);
  for_each_input(Refusal::kTime, early);
  for_each_input(Refusal::kVersion, wrong_version);
  expect_refused(Refusal::kValue, with_state(endless));
  expect_refused(Refusal::kValue, with_voxels(endless));
  expect_refused(Refusal::kValue, with_obstacles([](obstacles_t& list) { list.obstacles[0].shape = 7; }));
  expect_refused(Refusal::kSequence, with_state([](robot_state_t& state) { state.header.seq = 0; }));
  expect_refused(Refusal::kSequence, with_obstacles([](obstacles_t& list) { list.header.seq = 1; }));
  f.deliver("OTHER", garbage);
  EXPECT_EQ(f.out.maps, 2);  // none of these caused a map
  f.run_for(0.1);
  EXPECT_EQ(f.out.maps, 3);
  EXPECT_EQ(f.out.map.geometry, before.geometry);
  EXPECT_EQ(f.out.map.words(), before.words());
  f.run_for(0.9);
  for (int i = 0; i < kNumRefusals; ++i) {
    EXPECT_EQ(f.out.status.refused[i], f.node.refused()[static_cast<Refusal>(i)]) << i;
  }
}

TEST(MapNode, VoxelObstaclesAreLimitedInNumber) {
  Fixture f;
  for (int id = 0; id < 300; ++id) {
    auto message = f.message<obstacle_voxels_t>();
    message.id = id;
    message.resolution = 0.1;
    f.send(channel::kObstacleVoxels, message);
  }
  EXPECT_EQ(f.node.refused()[Refusal::kLength], 44);
}

TEST(MapNode, WhenTheClockIsSetAllThatItKnowsMoves) {
  for (const Duration step : {Duration(-1h), Duration(1h), Duration(300ms)}) {
    SCOPED_TRACE(step.count());
    Fixture f;
    f.send_state();
    f.send(channel::kObstacles, f.one_sphere({1, 0, 1}, {1, 0, 0}));
    f.run_for(0.3);
    EXPECT_TRUE(f.occupied(0, {1.3, 0, 1}));
    const int maps = f.out.maps, statuses = f.out.statuses;
    f.set_clock(step);
    f.run_for(0.15);
    EXPECT_GT(f.out.maps, maps);
    EXPECT_TRUE(f.occupied(0, {1.4, 0, 1}));
    EXPECT_FALSE(f.occupied(0, {1.0, 0, 1}));
    EXPECT_FALSE(f.occupied(0, {1.75, 0, 1}));
    f.run_for(1.05);
    EXPECT_GT(f.out.statuses, statuses);
    EXPECT_TRUE(f.out.status.state == map_status_t::kStaleState);
  }
}

TEST(MapNode, ReportsBuildTimesOfItsStopwatch) {
  std::chrono::nanoseconds passed{};
  Fixture f(Fixture::default_config(), [&passed] { return passed += 2500us; });
  f.send_state();
  f.run_for(1.0);
  EXPECT_FLOAT_EQ(f.out.status.build_ms, 2.5f);
}

TEST(MapConfig, RefusesWhatCannotWork) {
  const auto complaint = [](const std::function<void(MapConfig&)>& change) -> std::string {
    MapConfig config;
    change(config);
    try {
      MapNode(config, 1);
    } catch (const OptionError& error) {
      return error.what();
    }
    return "";
  };
  const auto expect_named = [&](const char* name, const char* value, const std::function<void(MapConfig&)>& change) {
    const std::string message = complaint(change);
    EXPECT_TRUE(message.starts_with(name)) << message;
    EXPECT_NE(message.find(value), std::string::npos) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  };
  EXPECT_EQ(complaint([](MapConfig&) {}), "");
  EXPECT_EQ(complaint([](MapConfig& c) { c.frame_s = 0.05; }), "");
  EXPECT_EQ(complaint([](MapConfig& c) { c.resolution_m = 0.15; }), "");  // 66.67 voxels: rounded up
  expect_named("window", "2000", [](MapConfig& c) { c.least_window_m.x() = 200; });
  expect_named("window", "at most", [](MapConfig& c) { c.least_window_m = {100, 100, 10}; });
  expect_named("window", "bytes", [](MapConfig& c) { c.least_window_m = {50, 50, 6.4}; });
  expect_named("v-max", "voxels of --resolution", [](MapConfig& c) { c.v_max_mps = 30.0, c.a_max_mps2 = 3.0; });
  expect_named("v-max", "bytes", [](MapConfig& c) { c.v_max_mps = 12.0, c.a_max_mps2 = 5.0; });
  expect_named("resolution", "0.005", [](MapConfig& c) { c.resolution_m = 0.005; });
  expect_named("horizon", "6.66", [](MapConfig& c) { c.frame_s = 0.3; });
  expect_named("horizon", "200", [](MapConfig& c) { c.frame_s = 0.01; });
  expect_named("horizon", "0.05", [](MapConfig& c) { c.horizon_s = 0.05; });
  expect_named("max-rate", "5", [](MapConfig& c) { c.max_rate_hz = 5; });
  MapConfig config;
  config.static_map = "no_such_map.bt";
  EXPECT_THROW(MapNode(config, 1), std::runtime_error);
}

// A robot at full speed comes to rest inside its window, half a second after it was told to.
TEST(MapConfig, TheWindowFitsTheLimits) {
  MapConfig config;
  EXPECT_EQ(config.voxels(), Eigen::Vector3i(100, 100, 40));
  config.v_max_mps = 6.0;  // 3 m to stop, 3 m until then, 0.5 m for itself
  EXPECT_EQ(config.voxels(), Eigen::Vector3i(130, 130, 40));
  config.a_max_mps2 = 1.0;
  EXPECT_EQ(config.voxels(), Eigen::Vector3i(430, 430, 40));
  config.least_window_m.x() = 50.0;
  EXPECT_EQ(config.voxels(), Eigen::Vector3i(500, 430, 40));
}

TEST(MapConfig, DeclaredDefaultsAreTheStructs) {
  MapConfig config;
  OptionSet options("map_daemon", "test");
  declare(options, config);
  const char* const arguments[] = {"map_daemon", "--robot-id", "7", "--window", "8,6,3", "--margin", "0.1"};
  std::ostringstream out;
  EXPECT_EQ(options.parse(7, arguments, out), OptionSet::Parsed::kRun);
  EXPECT_EQ(config.robot_id, 7);
  EXPECT_EQ(config.voxels(), Eigen::Vector3i(80, 60, 30));
  EXPECT_EQ(config.margin_m, 0.1);
  EXPECT_EQ(config.num_frames(), 20);
}

}  // namespace
}  // namespace swarm
