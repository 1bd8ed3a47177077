#include "tools/logs/log_drawing.h"

#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "tools/logs/foxglove.h"
#include "tools/logs/polytope_faces.h"

namespace swarm {
namespace {

using namespace sogm_swarm;
using foxglove::Color;
using foxglove::Json;
using foxglove::Pose;

constexpr Duration kSceneInterval = 100ms;
constexpr Duration kVoxelsLifetime = 1s;  // as map_daemon forgets them
constexpr float kUsualRadius_m = 0.2f;    // of robots that did not say
constexpr double kGoal_m = 0.2, kCommitted_m = 0.04, kPending_m = 0.03;
constexpr int kSamplesPerPiece = 6;
constexpr int kRingPoints = 32;
constexpr double kCorridorReach_m = 100.0;
constexpr std::size_t kScanPoints = 100'000;  // all of any scan
constexpr double kSigmas = 2.0;               // of an obstacle's position are drawn around it
constexpr Color kObstacle = {0.55, 0.55, 0.58, 0.9}, kUncertain = {0.55, 0.55, 0.58, 0.2};
constexpr Color kMask = {0.3, 0.5, 0.9, 0.15};

Color color_of(int id, double opacity) {
  static constexpr std::array<Color, 8> kColors = {{{0.12, 0.47, 0.71},
                                                    {1.0, 0.5, 0.05},
                                                    {0.17, 0.63, 0.17},
                                                    {0.84, 0.15, 0.16},
                                                    {0.58, 0.4, 0.74},
                                                    {0.55, 0.34, 0.29},
                                                    {0.89, 0.47, 0.76},
                                                    {0.09, 0.75, 0.81}}};
  Color color = kColors[static_cast<std::size_t>(id) % kColors.size()];
  color.a = opacity;
  return color;
}

std::string frame_of(int id) {
  return "robot" + std::to_string(id);
}
std::string topic_of(int id, const char* name) {
  return "/robot" + std::to_string(id) + "/" + name;
}

Eigen::Vector3d vector_of(const double (&values)[3]) {
  return {values[0], values[1], values[2]};
}

Json line_of(const Trajectory& trajectory, double thickness_m, const Color& color) {
  const int samples = kSamplesPerPiece * trajectory.num_pieces();
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i <= samples; ++i)
    points.push_back(trajectory.at(trajectory.start_utime() + i * trajectory.piece() / kSamplesPerPiece).position);
  return foxglove::line({}, points, false, thickness_m, color);
}

Json scene_of(Json entity) {
  return foxglove::scene(Json::array({std::move(entity)}), Json::array());
}

// `grown_m` larger to every side.
void draw_obstacle(const obstacle_t& obstacle, double grown_m, const Color& color, Json* entity) {
  // Where it is at the message's time.
  const Pose pose = {vector_of(obstacle.position) + obstacle.age_s * vector_of(obstacle.velocity), obstacle.yaw};
  const auto& size = obstacle.size;
  switch (obstacle.shape) {
    case obstacle_t::kColumn:
      (*entity)["cylinders"].push_back(
          foxglove::cylinder(pose, size[0] + 2.0 * grown_m, size[1] + 2.0 * grown_m, color));
      break;
    case obstacle_t::kRing: {
      std::array<Eigen::Vector3d, kRingPoints> circle;  // its axis is the pose's x
      for (int i = 0; i < kRingPoints; ++i) {
        const double angle = 2.0 * std::numbers::pi * i / kRingPoints;
        circle[i] = size[0] * Eigen::Vector3d(0.0, std::cos(angle), std::sin(angle));
      }
      (*entity)["lines"].push_back(foxglove::line(pose, circle, true, size[1] + 2.0 * grown_m, color));
      break;
    }
    case obstacle_t::kBox:
      (*entity)["cubes"].push_back(foxglove::cube(pose, vector_of(size).array() + 2.0 * grown_m, color));
      break;
    case obstacle_t::kSphere:
      (*entity)["spheres"].push_back(foxglove::sphere(pose, size[0] + 2.0 * grown_m, color));
      break;
  }
}

}  // namespace

void LogDrawing::draw_scene(Utime utime, int id, Robot* robot) {
  robot->scene.done(utime);
  Json entities = Json::array(), deletions = Json::array();
  if (robot->has_frame || robot->position) {
    Json body = foxglove::entity(utime, "robot", robot->has_frame ? frame_of(id) : "world");
    const Pose pose = {robot->has_frame ? Eigen::Vector3d::Zero().eval() : *robot->position, 0.0};
    body["spheres"].push_back(
        foxglove::sphere(pose, 2.0 * robot->radius_m.value_or(kUsualRadius_m), color_of(id, 1.0)));
    entities.push_back(std::move(body));
  }
  const std::pair<const char*, const Trajectory*> lines[] = {{"committed", &robot->committed},
                                                             {"pending", &robot->pending}};
  for (const auto& [name, trajectory] : lines) {
    if (trajectory->empty()) {
      deletions.push_back(foxglove::deletion(utime, name));
      continue;
    }
    const bool committed = trajectory == &robot->committed;
    Json entity = foxglove::entity(utime, name);
    entity["lines"].push_back(
        line_of(*trajectory, committed ? kCommitted_m : kPending_m, color_of(id, committed ? 0.9 : 0.4)));
    entities.push_back(std::move(entity));
  }
  if (!robot->mission.empty()) {
    Json entity = foxglove::entity(utime, "goal");
    for (const Waypoint& waypoint : robot->mission) {
      entity["cubes"].push_back(
          foxglove::cube({waypoint.position, 0.0}, Eigen::Vector3d::Constant(kGoal_m), color_of(id, 0.6)));
    }
    entities.push_back(std::move(entity));
  }
  sink_({topic_of(id, "scene"), foxglove::kSceneUpdate, foxglove::scene(std::move(entities), std::move(deletions))});
}

void LogDrawing::draw(Utime utime, const robot_state_t& m) {
  const int id = m.header.robot_id;
  Robot& robot = robots_[id];
  robot.position = vector_of(m.position);
  const Json transform = foxglove::transform(utime, "world", frame_of(id), {*robot.position, m.yaw});
  sink_({"/tf", foxglove::kFrameTransforms, {{"transforms", Json::array({transform})}}});
  if (!std::exchange(robot.has_frame, true)) draw_scene(utime, id, &robot);
}

void LogDrawing::draw(Utime utime, const announcement_t& m) {
  const int id = m.header.robot_id;
  Robot& robot = robots_[id];
  if (robot.announcements.pass(m.header) != Refusal::kNone) return;
  masks_.hear(m, utime);
  const bool changed =
      robot.radius_m != m.radius || robot.committed.seq() != m.committed.seq || robot.pending.seq() != m.pending.seq;
  robot.radius_m = m.radius;
  robot.committed = Trajectory::from_wire(m.committed);
  robot.pending = Trajectory::from_wire(m.pending);
  if (!robot.has_frame && !robot.committed.empty()) robot.position = robot.committed.at(utime).position;
  if (changed || utime >= robot.scene.due(utime, kSceneInterval)) draw_scene(utime, id, &robot);
}

void LogDrawing::draw(Utime utime, const goal_t& m) {
  Robot& robot = robots_[m.header.robot_id];
  robot.mission = mission_of(m);
  draw_scene(utime, m.header.robot_id, &robot);
}

void LogDrawing::draw(Utime utime, const obstacles_t& m) {
  Json entity = foxglove::entity(utime, "obstacles");
  for (const obstacle_t& obstacle : m.obstacles) {
    draw_obstacle(obstacle, 0.0, kObstacle, &entity);
    const double uncertain_m = kSigmas * double{obstacle.position_sigma};
    if (uncertain_m > 0.0) draw_obstacle(obstacle, uncertain_m, kUncertain, &entity);
  }
  sink_({topic_of(m.header.robot_id, "obstacles"), foxglove::kSceneUpdate, scene_of(std::move(entity))});
}

void LogDrawing::draw(Utime utime, const obstacle_voxels_t& m) {
  Json entity = foxglove::entity(utime, "voxels " + std::to_string(m.id), "world", kVoxelsLifetime);
  const Eigen::Vector3d origin = vector_of(m.position) + m.age_s * vector_of(m.velocity);
  for (const auto& voxel : m.voxels) {
    const Pose pose = {origin + m.resolution * Eigen::Vector3d(voxel[0], voxel[1], voxel[2]), 0.0};
    entity["cubes"].push_back(foxglove::cube(pose, Eigen::Vector3d::Constant(m.resolution), kObstacle));
  }
  sink_({topic_of(m.header.robot_id, "obstacle_voxels"), foxglove::kSceneUpdate, scene_of(std::move(entity))});
}

void LogDrawing::draw_grid(Utime utime, bool is_seen_space, const sogm_t& m) {
  Robot& robot = robots_[m.header.robot_id];
  Grid& grid = is_seen_space ? robot.seen_space : robot.map;
  if (grid.assembler.add(m, &grid_).status != AssemblyStatus::kComplete) return;
  if (utime < grid.drawn.due(utime, to_duration(options_.map_interval_s))) return;
  grid.drawn.done(utime);
  sogm_surface(grid_, is_seen_space ? 0 : kAllFrames, &surface_);
  std::vector<Eigen::Vector4f> points;
  points.reserve(surface_.size());
  const double frame_s = to_seconds(grid_.frame_duration);
  for (const SurfaceVoxel& voxel : surface_) {
    Eigen::Vector4d point;
    point << grid_.geometry.center_of({voxel.x, voxel.y, voxel.z}), frame_s * voxel.first_frame;
    points.push_back(point.cast<float>());
  }
  sink_({topic_of(m.header.robot_id, is_seen_space ? "seen_space" : "sogm"), foxglove::kPointCloud,
         foxglove::point_cloud(utime, points)});
}

void LogDrawing::draw(Utime utime, const depth_image_t& m) {
  const ScanPicture* const scan = robots_[m.header.robot_id].scans.add(m, &masks_);
  draw_scan(utime, m.header.robot_id, "depth" + std::to_string(m.sensor), scan);
}

void LogDrawing::draw(Utime utime, const lidar_scan_t& m) {
  const ScanPicture* const scan = robots_[m.header.robot_id].scans.add(m, &masks_);
  draw_scan(utime, m.header.robot_id, "lidar" + std::to_string(m.sensor), scan);
}

void LogDrawing::draw_scan(Utime utime, int id, const std::string& sensor, const ScanPicture* scan) {
  if (scan == nullptr) return;
  const std::vector<Eigen::Vector4f> points = scan->points(kScanPoints);
  sink_({topic_of(id, sensor.c_str()), foxglove::kPointCloud, foxglove::point_cloud(utime, points)});
  Json entity = foxglove::entity(utime, "masks");
  for (const PeerMask::Ball& robot : scan->robots())
    entity["spheres"].push_back(foxglove::sphere({robot.center, 0.0}, 2.0 * robot.radius_m, kMask));
  sink_({topic_of(id, "masks"), foxglove::kSceneUpdate, scene_of(std::move(entity))});
}

void LogDrawing::draw(Utime utime, const corridors_t& m) {
  const int id = m.header.robot_id;
  const Eigen::Vector3d middle = robots_[id].position.value_or(Eigen::Vector3d::Zero());
  Json entity = foxglove::entity(utime, "corridors");
  for (const CorridorPiece& piece : corridor_pieces(m)) {
    entity["triangles"].push_back(
        foxglove::polygons(polytope_faces(piece.half_spaces, middle, kCorridorReach_m), color_of(id, 0.12)));
  }
  sink_({topic_of(id, "corridors"), foxglove::kSceneUpdate, scene_of(std::move(entity))});
}

}  // namespace swarm
