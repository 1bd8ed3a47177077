// What is drawn of messages: at the right places, again when it changes, in Foxglove's schemas.
#include "tools/logs/log_drawing.h"

#include <Eigen/Geometry>
#include <cstring>

#include "map_daemon/obstacle.h"
#include "tests/support/column_scan.h"
#include "tests/support/harness.h"
#include "tests/support/json_schema.h"
#include "tests/support/random_map.h"
#include "tools/logs/foxglove.h"

namespace swarm::test {
namespace {

using namespace sogm_swarm;
using foxglove::Json;

// Everything drawn, which must fit its schema.
struct Canvas {
  explicit Canvas(const DrawingOptions& options = {})
      : drawing(options, [this](const Drawing& drawn) {
          EXPECT_EQ(misfit(foxglove::schema(drawn.schema), drawn.message), "") << drawn.topic;
          all.push_back(drawn);
        }) {}

  const Json& newest(const std::string& topic) const {
    const auto at = std::find_if(all.rbegin(), all.rend(), [&](const Drawing& drawn) { return drawn.topic == topic; });
    if (at == all.rend()) throw std::runtime_error("nothing on " + topic);
    return at->message;
  }
  std::size_t count(const std::string& topic) const {
    return static_cast<std::size_t>(
        std::count_if(all.begin(), all.end(), [&](const Drawing& drawn) { return drawn.topic == topic; }));
  }

  template <class T>
  void add(Utime utime, const T& message, const char* channel = "") {
    drawing.add(utime, channel, message);
  }

  std::vector<Drawing> all;
  LogDrawing drawing;
};

Eigen::Vector3d point_of(const Json& json) {
  return {json["x"].get<double>(), json["y"].get<double>(), json["z"].get<double>()};
}
// A point of a primitive in the world.
Eigen::Vector3d placed(const Json& pose, const Eigen::Vector3d& point) {
  const Json& q = pose["orientation"];
  const Eigen::Quaterniond rotation(q["w"].get<double>(), q["x"].get<double>(), q["y"].get<double>(),
                                    q["z"].get<double>());
  return point_of(pose["position"]) + rotation * point;
}

const Json* entity_of(const Json& scene, const std::string& id) {
  for (const Json& entity : scene["entities"]) {
    if (entity["id"] == id) return &entity;
  }
  return nullptr;
}

announcement_t announcement_of(int robot, std::int64_t seq, Utime utime, const Trajectory& committed,
                               const Trajectory& pending = {}) {
  announcement_t message{};
  message.header = make_header(robot, 1, seq, utime);
  message.radius = 0.3f;
  message.committed = committed.to_wire();
  message.pending = pending.to_wire();
  message.pending_state = pending.empty() ? announcement_t::kNone : announcement_t::kAnnounced;
  return message;
}

Trajectory flight(std::int32_t seq, const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  MotionState start;
  start.position = from;
  return quintic_to(start, kStart, to, 2.0, 5, seq);
}

TEST(LogDrawing, RobotsMoveInTheWorld) {
  Canvas canvas;
  robot_state_t state = state_at(4, {1, 2, 3}, 1, kStart);
  state.yaw = 0.6;
  canvas.add(kStart, state);
  const Json& transform = canvas.newest("/tf")["transforms"][0];
  EXPECT_EQ(transform["parent_frame_id"], "world");
  EXPECT_EQ(transform["child_frame_id"], "robot4");
  EXPECT_EQ(point_of(transform["translation"]), Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR(transform["rotation"]["z"].get<double>(), std::sin(0.3), 1e-12);
  EXPECT_EQ(transform["timestamp"]["sec"], kStart.time_since_epoch() / 1s);
  const Json* const body = entity_of(canvas.newest("/robot4/scene"), "robot");
  ASSERT_NE(body, nullptr);
  EXPECT_EQ((*body)["frame_id"], "robot4");
  EXPECT_EQ((*body)["frame_locked"], true);
  EXPECT_NEAR((*body)["spheres"][0]["size"]["x"].get<double>(), 0.4, 1e-4) << "it did not say its radius";
}

TEST(LogDrawing, ScenesHoldTrajectoriesAndGoal) {
  Canvas canvas;
  const Trajectory committed = flight(1, {0, 0, 1}, {2, 0, 1}), pending = flight(2, {0, 0, 1}, {0, 3, 1});
  canvas.add(kStart, announcement_of(2, 1, kStart, committed, pending));
  goal_t goal = to_goal({{{0, 7, 0}}, {{1, 2, 3}}});
  goal.header = make_header(2, 1, 1, kStart);
  canvas.add(kStart, goal);
  Json scene = canvas.newest("/robot2/scene");
  const Json* const body = entity_of(scene, "robot");
  ASSERT_NE(body, nullptr);
  EXPECT_EQ((*body)["frame_id"], "world") << "no state was heard";
  EXPECT_EQ(point_of((*body)["spheres"][0]["pose"]["position"]), Eigen::Vector3d(0, 0, 1));
  EXPECT_NEAR((*body)["spheres"][0]["size"]["x"].get<double>(), 0.6, 1e-4);
  const std::pair<const char*, const Trajectory*> lines[] = {{"committed", &committed}, {"pending", &pending}};
  for (const auto& [name, trajectory] : lines) {
    const Json* const entity = entity_of(scene, name);
    ASSERT_NE(entity, nullptr);
    const Json& points = (*entity)["lines"][0]["points"];
    ASSERT_EQ(points.size(), 31u);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Utime utime = kStart + i * trajectory->piece() / 6;
      EXPECT_LT((point_of(points[i]) - trajectory->at(utime).position).norm(), 1e-4);
    }
  }
  EXPECT_LT((*entity_of(scene, "pending"))["lines"][0]["color"]["a"],
            (*entity_of(scene, "committed"))["lines"][0]["color"]["a"]);
  const auto goals = (*entity_of(scene, "goal"))["cubes"];
  ASSERT_EQ(goals.size(), 2u);
  EXPECT_EQ(point_of(goals[0]["pose"]["position"]), Eigen::Vector3d(0, 7, 0));
  EXPECT_EQ(point_of(goals[1]["pose"]["position"]), Eigen::Vector3d(1, 2, 3));
  EXPECT_TRUE(scene["deletions"].empty());

  // What is no longer pending goes.
  canvas.add(kStart + 10us, announcement_of(2, 2, kStart + 10us, committed));
  scene = canvas.newest("/robot2/scene");
  EXPECT_EQ(entity_of(scene, "pending"), nullptr);
  ASSERT_EQ(scene["deletions"].size(), 1u);
  EXPECT_EQ(scene["deletions"][0]["id"], "pending");
}

TEST(LogDrawing, ScenesComeWithChangesAndTenTimesASecond) {
  Canvas canvas;
  const Trajectory first = flight(1, {0, 0, 1}, {2, 0, 1}), second = flight(2, {0, 0, 1}, {2, 1, 1});
  std::int64_t seq = 0;
  Utime utime = kStart;
  const auto hear = [&](const Trajectory& committed) {
    const announcement_t message = announcement_of(2, ++seq, utime, committed);
    for (int copy = 0; copy < 3; ++copy) canvas.add(utime, message);
    utime += 10ms;
  };
  for (int i = 0; i < 20; ++i) hear(first);  // 0 to 190 ms
  EXPECT_EQ(canvas.count("/robot2/scene"), 2u);
  hear(second);
  EXPECT_EQ(canvas.count("/robot2/scene"), 3u);
  canvas.add(utime, announcement_of(2, 1, utime, first));  // of before
  EXPECT_EQ(canvas.count("/robot2/scene"), 3u);
}

TEST(LogDrawing, ObstaclesStandWhereTheyAre) {
  Canvas canvas;
  obstacles_t message{};
  message.header = make_header(1, 1, 1, kStart);
  const double sizes[4][3] = {{0.8, 2.0, 0.0}, {1.5, 0.2, 0.0}, {1.0, 2.0, 3.0}, {0.6, 0.0, 0.0}};
  for (std::int16_t shape = obstacle_t::kColumn; shape <= obstacle_t::kSphere; ++shape) {
    obstacle_t obstacle{};
    obstacle.shape = shape;
    obstacle.position[0] = 10.0 * shape;
    obstacle.velocity[1] = 2.0;
    obstacle.age_s = 0.5;
    obstacle.yaw = 0.4;
    std::copy_n(sizes[shape], 3, obstacle.size);
    message.obstacles.push_back(obstacle);
  }
  canvas.add(kStart, message);
  const Json scene = canvas.newest("/robot1/obstacles");
  ASSERT_EQ(scene["entities"].size(), 1u);
  const Json& entity = scene["entities"][0];
  const std::pair<const char*, int> kinds[] = {{"cylinders", 0}, {"lines", 1}, {"cubes", 2}, {"spheres", 3}};
  for (const auto& [kind, shape] : kinds) {
    ASSERT_EQ(entity[kind].size(), 1u) << kind;
    EXPECT_EQ(point_of(entity[kind][0]["pose"]["position"]), Eigen::Vector3d(10.0 * shape, 1, 0)) << kind;
  }
  EXPECT_EQ(point_of(entity["cylinders"][0]["size"]), Eigen::Vector3d(0.8, 0.8, 2.0));
  EXPECT_EQ(point_of(entity["cubes"][0]["size"]), Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR(entity["cubes"][0]["pose"]["orientation"]["z"].get<double>(), std::sin(0.2), 1e-12);
  // The ring's line is the middle of its tube.
  const Json& ring = entity["lines"][0];
  const Shape inner = {.kind = Shape::Kind::kRing, .size = {1.5, 0.001, 0}, .yaw_rad = 0.4};
  EXPECT_EQ(ring["thickness"], 0.2);
  for (const Json& point : ring["points"])
    EXPECT_LT(distance(inner, placed(ring["pose"], point_of(point)) - Eigen::Vector3d(10, 1, 0)), 1e-3);

  // They are one entity: what is not seen any more is gone with the next message.
  message.obstacles.resize(1);
  canvas.add(kStart + 1us, message);
  EXPECT_EQ(canvas.newest("/robot1/obstacles")["entities"][0]["id"], entity["id"]);
  EXPECT_TRUE(canvas.newest("/robot1/obstacles")["entities"][0]["cubes"].empty());
}

TEST(LogDrawing, SetsOfVoxelsAreCubes) {
  Canvas canvas;
  obstacle_voxels_t message{};
  message.header = make_header(1, 1, 1, kStart);
  message.id = 9;
  message.position[2] = 1.0;
  message.resolution = 0.25;
  message.voxels = {{0, 0, 0}, {1, -2, 4}};
  canvas.add(kStart, message);
  const Json& entity = canvas.newest("/robot1/obstacle_voxels")["entities"][0];
  EXPECT_EQ(entity["id"], "voxels 9");
  EXPECT_EQ(entity["lifetime"]["sec"], 1);
  ASSERT_EQ(entity["cubes"].size(), 2u);
  EXPECT_EQ(point_of(entity["cubes"][1]["pose"]["position"]), Eigen::Vector3d(0.25, -0.5, 2.0));
}

std::vector<float> floats_of(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::vector<std::uint8_t> bytes;
  std::uint32_t word = 0;
  int bits = 0;
  for (const char c : text.substr(0, text.find('='))) {
    word = word << 6 | static_cast<std::uint32_t>(digits.find(c));
    if ((bits += 6) < 8) continue;
    bits -= 8;
    bytes.push_back(static_cast<std::uint8_t>(word >> bits));
  }
  std::vector<float> floats(bytes.size() / sizeof(float));
  std::memcpy(floats.data(), bytes.data(), floats.size() * sizeof(float));
  return floats;
}

TEST(LogDrawing, MapsAreTheirSurface) {
  Canvas canvas({.map_interval_s = 0.2});
  Rng rng(3);
  SogmEncoder encoder;
  Sogm map;
  for (int i = 0; i < 9; ++i) {  // every 0.05 s
    map = random_map(rng, 5, {4, 3, 2}, 6, kStart + i * 50ms, 100ms);
    for (const sogm_t& part : encoder.encode(map, make_header(3, 1, i, Utime()))) canvas.add(kStart + i * 50ms, part);
  }
  EXPECT_EQ(canvas.count("/robot3/sogm"), 3u);
  std::vector<SurfaceVoxel> surface;
  sogm_surface(map, kAllFrames, &surface);
  const std::vector<float> floats = floats_of(canvas.newest("/robot3/sogm")["data"]);
  ASSERT_EQ(floats.size(), 4 * surface.size());
  ASSERT_GT(surface.size(), 50u);
  for (std::size_t i = 0; i < surface.size(); ++i) {
    const SurfaceVoxel& voxel = surface[i];
    const Eigen::Vector3f center = map.geometry.center_of({voxel.x, voxel.y, voxel.z}).cast<float>();
    for (int axis = 0; axis < 3; ++axis) EXPECT_EQ(floats[4 * i + static_cast<std::size_t>(axis)], center[axis]);
    EXPECT_FLOAT_EQ(floats[4 * i + 3], 0.1f * static_cast<float>(voxel.first_frame));
  }
}

TEST(LogDrawing, WhatWasSeenIsNoMap) {
  Canvas canvas;
  Rng rng(3);
  SogmEncoder encoder;
  const Sogm seen = random_map(rng, 2, {4, 3, 2}, 6, kStart, 100ms);
  for (const sogm_t& part : encoder.encode(seen, make_header(3, 1, 1, kStart)))
    canvas.add(kStart, part, channel::kSeenSpace);
  EXPECT_EQ(canvas.count("/robot3/sogm"), 0u);
  std::vector<SurfaceVoxel> standing;
  sogm_surface(seen, 0, &standing);
  ASSERT_GT(standing.size(), 10u);
  EXPECT_EQ(floats_of(canvas.newest("/robot3/seen_space")["data"]).size(), 4 * standing.size());
}

TEST(LogDrawing, ScansShowWhichPointsAreRobots) {
  Canvas canvas;
  const Eigen::Vector3d peer(2.0, 0.0, 1.0);
  canvas.add(kStart, announcement_of(1, 1, kStart, Trajectory::hover(1, kStart, peer)));
  lidar_scan_t scan = column_scan({0, 0, 1}, {{{2.0, 0.0}, 0.2, 0.8, 1.2}, {{0.0, 3.0}}});
  scan.header = make_header(0, 1, 1, kStart);
  scan.sensor = 2;
  canvas.add(kStart, scan);
  const std::vector<float> points = floats_of(canvas.newest("/robot0/lidar2")["data"]);
  int on_peer = 0, elsewhere = 0;
  for (std::size_t i = 0; i + 3 < points.size(); i += 4) {
    const bool is_peer = points[i] > 1.0f;
    (is_peer ? on_peer : elsewhere) += 1;
    EXPECT_EQ(points[i + 3], is_peer ? 1.0f : 0.0f) << points[i] << ' ' << points[i + 1];
  }
  EXPECT_GT(on_peer, 10);
  EXPECT_GT(elsewhere, 10);
  const Json& masks = canvas.newest("/robot0/masks")["entities"][0]["spheres"];
  ASSERT_EQ(masks.size(), 1u);
  EXPECT_EQ(point_of(masks[0]["pose"]["position"]), peer);
  EXPECT_NEAR(masks[0]["size"]["x"].get<double>(), 2.0 * (0.3 + 0.15), 1e-6);
}

TEST(LogDrawing, UncertainObstaclesHaveAShell) {
  Canvas canvas;
  obstacles_t message{};
  message.header = make_header(1, 1, 1, kStart);
  obstacle_t column{};
  column.size[0] = 0.8, column.size[1] = 2.0;
  column.position_sigma = 0.05f;
  message.obstacles = {column};
  canvas.add(kStart, message);
  const Json drawn = canvas.newest("/robot1/obstacles")["entities"][0]["cylinders"];
  ASSERT_EQ(drawn.size(), 2u);
  EXPECT_NEAR(drawn[1]["size"]["x"].get<double>(), 0.8 + 4 * 0.05, 1e-6);
  EXPECT_LT(drawn[1]["color"]["a"], drawn[0]["color"]["a"]);
}

TEST(LogDrawing, CorridorsAreTheirPolytopes) {
  Canvas canvas;
  canvas.add(kStart, state_at(5, {20, 0, 1}, 1, kStart));
  corridors_t message{};
  message.header = make_header(5, 1, 1, kStart);
  const Eigen::Vector3d middles[] = {{20, 0, 1}, {21, 1, 1}};
  for (std::int16_t piece = 0; piece < 2; ++piece) {
    for (int side = 0; side < 6; ++side) {
      face_t face{};
      face.piece = piece;
      face.normal[side / 2] = side % 2 == 0 ? 1.0f : -1.0f;
      face.offset = static_cast<float>(face.normal[side / 2] * middles[piece][side / 2] + 1.0);
      message.faces.push_back(face);
    }
  }
  message.num_faces = static_cast<std::int32_t>(message.faces.size());
  canvas.add(kStart, message);
  const Json& triangles = canvas.newest("/robot5/corridors")["entities"][0]["triangles"];
  ASSERT_EQ(triangles.size(), 2u);
  for (std::size_t piece = 0; piece < 2; ++piece) {
    EXPECT_EQ(triangles[piece]["points"].size(), 24u);
    EXPECT_EQ(triangles[piece]["indices"].size(), 36u);
    for (const Json& point : triangles[piece]["points"])
      EXPECT_LT(((point_of(point) - middles[piece]).cwiseAbs().array() - 1.0).abs().maxCoeff(), 1e-4);
  }
}

}  // namespace
}  // namespace swarm::test
