#include "tools/viewer/picture_frame.h"

#include <array>
#include <bit>
#include <cmath>

#include "lcmtypes/bus/channels.h"
#include "planner_daemon/coordination/commit_protocol.h"
#include "tools/logs/polytope_faces.h"
#include "tools/logs/sogm_surface.h"
#include "tools/viewer/robot_health.h"

namespace swarm {

static_assert(std::endian::native == std::endian::little, "numbers are sent as they lie in memory");

using namespace sogm_swarm;

namespace {

constexpr int kPointsPerPiece = 6;
constexpr std::size_t kScanPoints = 10'000;  // of a scan, so many are drawn
constexpr double kReach_m = 20.0;            // corridors are drawn no further from their middle

// Enough digits for a screen.
double rounded(double value) {
  return std::round(value * 1e3) / 1e3;
}

Json vector_json(const Eigen::Vector3d& v) {
  return {rounded(v.x()), rounded(v.y()), rounded(v.z())};
}

Json vector_json(const double (&v)[3]) {
  return vector_json(Eigen::Vector3d(v));
}

void append(const Eigen::Vector3d& point, std::vector<float>* numbers) {
  for (int axis = 0; axis < 3; ++axis) numbers->push_back(static_cast<float>(point[axis]));
}

Json trajectory_json(const Trajectory& trajectory, Utime now, FrameWriter* writer) {
  if (trajectory.empty()) return nullptr;
  std::vector<float> points;
  const int count = trajectory.num_pieces() * kPointsPerPiece;
  for (int i = 0; i <= count; ++i) {
    const Utime utime = trajectory.start_utime() + i * trajectory.piece() / kPointsPerPiece;
    append(trajectory.state_at(utime).position, &points);
  }
  return {{"seq", trajectory.seq()},
          {"start_utime", to_us(trajectory.start_utime())},
          {"ends_in_s", rounded(to_seconds(trajectory.end_utime() - now))},
          {"points", writer->array(std::span<const float>(points))}};
}

template <class Status>
Json refused_json(const Status& status) {
  Json reasons = Json::object();
  for (int i = 1; i < kNumRefusals; ++i)
    if (status.refused[i] > 0) reasons[to_string(static_cast<Refusal>(i))] = status.refused[i];
  return reasons;
}

template <std::size_t size>
const char* name_of(const std::array<const char*, size>& names, int value) {
  return value >= 0 && value < static_cast<int>(size) ? names[static_cast<std::size_t>(value)] : "?";
}

Json planner_json(const planner_status_t& status) {
  static constexpr std::array kOutcomes = {"smooth", "raw", "unsafe"};
  return {{"state", state_name(status)},
          {"outcome", name_of(kOutcomes, status.outcome)},
          {"plans", status.plans},
          {"missed", status.missed},
          {"rate_hz", rounded(status.rate_hz)},
          {"total_ms", rounded(status.total_ms)},
          {"prepare_ms", rounded(status.prepare_ms)},
          {"steps_ms",
           {{"compose", rounded(status.compose_ms)},
            {"search", rounded(status.search_ms)},
            {"corridor", rounded(status.corridor_ms)},
            {"optimize", rounded(status.optimize_ms)},
            {"check", rounded(status.check_ms)}}},
          {"expansions", status.expansions},
          {"margin_m", rounded(status.margin)},
          {"refused", refused_json(status)}};
}

Json map_json(const map_status_t& status) {
  return {{"state", state_name(status)}, {"rate_hz", rounded(status.rate_hz)}, {"build_ms", rounded(status.build_ms)},
          {"bytes", status.map_bytes},   {"obstacles", status.obstacles},      {"refused", refused_json(status)}};
}

Json perception_json(const perception_status_t& status) {
  static constexpr std::array kMapStates = {"none", "kept", "full", "not written"};
  return {{"state", state_name(status)},
          {"rate_hz", rounded(status.rate_hz)},
          {"scan_ms", rounded(status.scan_ms)},
          {"points", status.points},
          {"masked", status.masked},
          {"moving", status.moving},
          {"standing", status.standing},
          {"jumps", status.jumps},
          {"blind", status.blind},
          {"map", name_of(kMapStates, status.map_state)},
          {"refused", refused_json(status)}};
}

Json broadcast_json(const broadcast_status_t& status) {
  Json rejected = Json::object();
  for (int i = 1; i < kNumRejections; ++i)
    if (status.rejected[i] > 0) rejected[to_string(static_cast<Rejection>(i))] = status.rejected[i];
  return {{"state", state_name(status)},
          {"candidates", status.candidates},
          {"commits", status.commits},
          {"forced", status.forced},
          {"withdrawn", status.withdrawn},
          {"rejected", rejected},
          {"peers_heard", status.peers_heard},
          {"lost", status.lost},
          {"tracking_error_m", rounded(status.tracking_error)},
          {"error_bound_m", rounded(status.error_bound)},
          {"max_age_ms", rounded(status.max_age_ms)},
          {"max_clock_offset_ms", rounded(status.max_clock_offset_ms)},
          {"refused", refused_json(status)}};
}

Json traffic_json(const RobotPicture& robot, Utime now) {
  Json all = Json::object();
  for (const auto& [channel, traffic] : robot.traffic) {
    if (channel == channel::kPeerTrajectory) continue;  // says what others heard of it
    all[channel] = {{"rate_hz", traffic.rate_hz(now)},
                    {"age_s", rounded(traffic.age_s(now))},
                    {"heard", traffic.heard()},
                    {"missing", traffic.missing()}};
  }
  return all;
}

}  // namespace

void FrameWriter::finish(const Json& text, std::vector<std::uint8_t>* bytes) const {
  std::string json = text.dump(-1, ' ', false, Json::error_handler_t::replace);
  while ((4 + json.size()) % 4 != 0) json.push_back(' ');
  const auto length = static_cast<std::uint32_t>(json.size());
  const auto* head = reinterpret_cast<const std::uint8_t*>(&length);
  bytes->assign(head, head + sizeof length);
  bytes->insert(bytes->end(), json.begin(), json.end());
  bytes->insert(bytes->end(), arrays_.begin(), arrays_.end());
}

Json robots_json(const SwarmPicture& picture, Utime now, FrameWriter* writer) {
  Json all = Json::array();
  for (const auto& [id, robot] : picture.robots()) {
    Json json = {{"id", id}};
    if (robot.radius_m > 0.0) json["radius"] = rounded(robot.radius_m);
    if (const auto position = robot.position(now)) json["position"] = vector_json(*position);
    if (robot.state) json["yaw"] = rounded(robot.state->yaw);
    if (const auto goal = robot.next_goal()) json["goal"] = vector_json(*goal);
    if (!robot.motion.committed.empty()) {
      json["speed"] = rounded(robot.motion.at(now).velocity.norm());
      json["announcement_age_s"] = rounded(robot.announcements.age_s(now));
      json["committed"] = trajectory_json(robot.motion.committed, now, writer);
      json["next"] = trajectory_json(robot.motion.next, now, writer);
      json["pending"] = trajectory_json(robot.pending, now, writer);
    }
    if (robot.planner) json["planner"] = planner_json(*robot.planner);
    if (robot.map) json["map"] = map_json(*robot.map);
    if (robot.broadcast) json["broadcast"] = broadcast_json(*robot.broadcast);
    if (robot.vehicle && robot.vehicle->battery >= 0.0f) json["battery"] = rounded(robot.vehicle->battery);
    json["trouble"] = trouble_of(robot, now);
    json["activity"] = activity_of(robot);
    if (robot.perception) json["perception"] = perception_json(*robot.perception);
    json["traffic"] = traffic_json(robot, now);
    json["has_sogm"] = robot.sogm.was_heard();
    json["has_sensors"] = robot.seen_space.was_heard();
    all.push_back(std::move(json));
  }
  return all;
}

Json obstacles_json(const SwarmPicture& picture, Utime now, int looker) {
  static constexpr std::array kShapes = {"column", "ring", "box", "sphere"};
  Json all = Json::array();
  for (const auto& [key, obstacle] : picture.obstacles(now, looker)) {
    const auto& [seen_by, id] = key;
    all.push_back({{"id", seen_by < 0 ? Json(id) : Json(std::to_string(seen_by) + ":" + std::to_string(id))},
                   {"shape", name_of(kShapes, obstacle.shape)},
                   {"position", vector_json(obstacle.position)},
                   {"velocity", vector_json(obstacle.velocity)},
                   {"yaw", rounded(obstacle.yaw)},
                   {"size", vector_json(obstacle.size)},
                   {"sigma", rounded(double{obstacle.position_sigma})}});
  }
  return all;
}

Json sogm_json(const Sogm& sogm, int frame, FrameWriter* writer) {
  std::vector<SurfaceVoxel> surface;
  sogm_surface(sogm, frame, &surface);
  static_assert(sizeof(SurfaceVoxel) == 4 * sizeof(std::int16_t));
  const auto* numbers = reinterpret_cast<const std::int16_t*>(surface.data());
  return {{"frame", frame},
          {"num_frames", sogm.num_frames},
          {"frame_duration_s", to_seconds(sogm.frame_duration)},
          {"start_utime", to_us(sogm.start_utime)},
          {"resolution", sogm.geometry.resolution_m},
          {"origin", {sogm.geometry.origin.x(), sogm.geometry.origin.y(), sogm.geometry.origin.z()}},
          {"size", {sogm.geometry.size.x(), sogm.geometry.size.y(), sogm.geometry.size.z()}},
          {"voxels", writer->array(std::span<const std::int16_t>(numbers, 4 * surface.size()))}};
}

Json scans_json(const RobotPicture& robot, Utime now, FrameWriter* writer) {
  std::vector<float> numbers;
  Json masks = Json::array();
  for (const auto& [sensor, scan] : robot.scans.sensors()) {
    if (std::chrono::abs(now - scan.utime()) > 1s) continue;
    for (const Eigen::Vector4f& point : scan.points(kScanPoints))
      numbers.insert(numbers.end(), point.begin(), point.end());
    for (const PeerMask::Ball& ball : scan.robots())
      masks.push_back({{"position", vector_json(ball.center)}, {"radius", rounded(ball.radius_m)}});
  }
  return {{"points", writer->array(std::span<const float>(numbers))}, {"masks", masks}};
}

Json corridors_json(const RobotPicture& robot, FrameWriter* writer) {
  std::vector<float> triangles, edges;
  const auto pieces = robot.corridors ? corridor_pieces(*robot.corridors) : std::vector<CorridorPiece>();
  const Eigen::Vector3d middle =
      robot.state ? Eigen::Vector3d(robot.state->position) : Eigen::Vector3d(Eigen::Vector3d::Zero());
  for (const CorridorPiece& piece : pieces) {
    for (const Polygon& face : polytope_faces(piece.half_spaces, middle, kReach_m)) {
      for (std::size_t i = 0; i < face.size(); ++i) {
        append(face[i], &edges);
        append(face[(i + 1) % face.size()], &edges);
        if (i < 2) continue;
        append(face[0], &triangles);
        append(face[i - 1], &triangles);
        append(face[i], &triangles);
      }
    }
  }
  return {{"pieces", pieces.size()},
          {"triangles", writer->array(std::span<const float>(triangles))},
          {"edges", writer->array(std::span<const float>(edges))}};
}

Json static_map_json(const OccupiedCubes& cubes, FrameWriter* writer) {
  std::vector<float> numbers;
  for (const OccupiedCubes::Cube& cube : cubes.cubes()) {
    append(cube.center, &numbers);
    numbers.push_back(static_cast<float>(2.0 * cube.half_edge_m));
  }
  return {{"cubes", writer->array(std::span<const float>(numbers))}};
}

}  // namespace swarm
