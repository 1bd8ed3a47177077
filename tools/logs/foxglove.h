// Messages of Foxglove's schemas (https://docs.foxglove.dev/docs/visualization/message-schemas) as JSON, as far as we
// draw with them. Lengths in m, W unless a frame is named; colors between 0 and 1.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "lcmtypes/bus/time.h"

namespace swarm::foxglove {

using Json = nlohmann::ordered_json;

inline constexpr char kSceneUpdate[] = "foxglove.SceneUpdate";
inline constexpr char kFrameTransforms[] = "foxglove.FrameTransforms";
inline constexpr char kPointCloud[] = "foxglove.PointCloud";

// The JSON Schema of one of these; std::invalid_argument for another name.
Json schema(const std::string& name);

struct Color {
  double r = 0.0, g = 0.0, b = 0.0, a = 1.0;
};
struct Pose {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  double yaw_rad = 0.0;  // about z
};

Json time(Utime utime);  // not before the epoch
Json transform(Utime utime, const std::string& parent, const std::string& child, const Pose& pose);

// Primitives of an entity; `size_m` and `diameter_m` are whole extents.
Json cube(const Pose& pose, const Eigen::Vector3d& size_m, const Color& color);
Json sphere(const Pose& pose, double diameter_m, const Color& color);
Json cylinder(const Pose& pose, double diameter_m, double height_m, const Color& color);
// Lines from point to point, when `closed` from the last to the first, too; points in the frame of `pose`.
Json line(const Pose& pose, std::span<const Eigen::Vector3d> points, bool closed, double thickness_m,
          const Color& color);
// Convex polygons, filled; corners in order.
Json polygons(std::span<const std::vector<Eigen::Vector3d>> polygons, const Color& color);

// What replaces the entity of the same id and topic; add primitives to its arrays: cubes, spheres, cylinders, lines,
// triangles. In another frame than "world" it moves with it. `lifetime` 0: until it is replaced.
Json entity(Utime utime, const std::string& id, const std::string& frame = "world", Duration lifetime = {});
Json deletion(Utime utime, const std::string& id);
Json scene(Json entities, Json deletions);

// Points (x, y, z, t): float32 each.
Json point_cloud(Utime utime, std::span<const Eigen::Vector4f> points);

std::string base64(std::span<const std::uint8_t> bytes);

}  // namespace swarm::foxglove
