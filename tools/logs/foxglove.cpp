#include "tools/logs/foxglove.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <initializer_list>
#include <iterator>
#include <stdexcept>
#include <utility>

namespace swarm::foxglove {
namespace {

using Properties = std::initializer_list<std::pair<const char*, Json>>;

Json object(const char* title, const Properties& properties) {
  Json schema = {{"title", title}, {"type", "object"}, {"properties", Json::object()}, {"required", Json::array()}};
  for (const auto& [name, property] : properties) {
    schema["properties"][name] = property;
    schema["required"].push_back(name);
  }
  return schema;
}
Json array(const Json& items) {
  return {{"type", "array"}, {"items", items}};
}

// The parts of the schemas.
const Json kNumber = {{"type", "number"}}, kInteger = {{"type", "integer"}}, kString = {{"type", "string"}},
           kBoolean = {{"type", "boolean"}}, kBase64 = {{"type", "string"}, {"contentEncoding", "base64"}};

Json clock_schema(const char* title) {
  const Json nsec = {{"type", "integer"}, {"minimum", 0}, {"maximum", 999'999'999}};
  return object(title, {{"sec", kInteger}, {"nsec", nsec}});
}
Json vector_schema(const char* title) {
  return object(title, {{"x", kNumber}, {"y", kNumber}, {"z", kNumber}});
}
Json quaternion_schema() {
  return object("foxglove.Quaternion", {{"x", kNumber}, {"y", kNumber}, {"z", kNumber}, {"w", kNumber}});
}
Json pose_schema() {
  return object("foxglove.Pose",
                {{"position", vector_schema("foxglove.Vector3")}, {"orientation", quaternion_schema()}});
}
Json color_schema() {
  return object("foxglove.Color", {{"r", kNumber}, {"g", kNumber}, {"b", kNumber}, {"a", kNumber}});
}

Json entity_schema() {
  const Json pose = pose_schema(), color = color_schema(), size = vector_schema("foxglove.Vector3");
  const Json points = array(vector_schema("foxglove.Point3")), colors = array(color), indices = array(kInteger);
  const Json pair = object("foxglove.KeyValuePair", {{"key", kString}, {"value", kString}});
  const Json arrow = object("foxglove.ArrowPrimitive", {{"pose", pose},
                                                        {"shaft_length", kNumber},
                                                        {"shaft_diameter", kNumber},
                                                        {"head_length", kNumber},
                                                        {"head_diameter", kNumber},
                                                        {"color", color}});
  const Json cube = object("foxglove.CubePrimitive", {{"pose", pose}, {"size", size}, {"color", color}});
  const Json sphere = object("foxglove.SpherePrimitive", {{"pose", pose}, {"size", size}, {"color", color}});
  const Json cylinder =
      object("foxglove.CylinderPrimitive",
             {{"pose", pose}, {"size", size}, {"bottom_scale", kNumber}, {"top_scale", kNumber}, {"color", color}});
  const Json line = object("foxglove.LinePrimitive", {{"type", kInteger},
                                                      {"pose", pose},
                                                      {"thickness", kNumber},
                                                      {"scale_invariant", kBoolean},
                                                      {"points", points},
                                                      {"color", color},
                                                      {"colors", colors},
                                                      {"indices", indices}});
  const Json triangles =
      object("foxglove.TriangleListPrimitive",
             {{"pose", pose}, {"points", points}, {"color", color}, {"colors", colors}, {"indices", indices}});
  const Json text = object("foxglove.TextPrimitive", {{"pose", pose},
                                                      {"billboard", kBoolean},
                                                      {"font_size", kNumber},
                                                      {"scale_invariant", kBoolean},
                                                      {"color", color},
                                                      {"text", kString}});
  const Json model = object("foxglove.ModelPrimitive", {{"pose", pose},
                                                        {"scale", size},
                                                        {"color", color},
                                                        {"override_color", kBoolean},
                                                        {"url", kString},
                                                        {"media_type", kString},
                                                        {"data", kBase64}});
  return object("foxglove.SceneEntity", {{"timestamp", clock_schema("time")},
                                         {"frame_id", kString},
                                         {"id", kString},
                                         {"lifetime", clock_schema("duration")},
                                         {"frame_locked", kBoolean},
                                         {"metadata", array(pair)},
                                         {"arrows", array(arrow)},
                                         {"cubes", array(cube)},
                                         {"spheres", array(sphere)},
                                         {"cylinders", array(cylinder)},
                                         {"lines", array(line)},
                                         {"triangles", array(triangles)},
                                         {"texts", array(text)},
                                         {"models", array(model)}});
}

// Tenths of a millimetre are enough to draw, and short.
double rounded(double length_m) {
  return std::round(length_m * 1e4) / 1e4;
}
Json json_of(const Eigen::Vector3d& v) {
  return {{"x", rounded(v.x())}, {"y", rounded(v.y())}, {"z", rounded(v.z())}};
}
Json json_of(Duration duration) {
  return {{"sec", duration / 1s}, {"nsec", duration % 1s / 1ns}};
}
Json json_of(const Color& color) {
  return {{"r", color.r}, {"g", color.g}, {"b", color.b}, {"a", color.a}};
}
Json rotation(double yaw_rad) {
  return {{"x", 0.0}, {"y", 0.0}, {"z", std::sin(yaw_rad / 2)}, {"w", std::cos(yaw_rad / 2)}};
}
Json json_of(const Pose& pose) {
  return {{"position", json_of(pose.position)}, {"orientation", rotation(pose.yaw_rad)}};
}

}  // namespace

Json schema(const std::string& name) {
  Json found;
  if (name == kSceneUpdate) {
    const Json deletion = object("foxglove.SceneEntityDeletion",
                                 {{"timestamp", clock_schema("time")}, {"type", kInteger}, {"id", kString}});
    found = object(kSceneUpdate, {{"deletions", array(deletion)}, {"entities", array(entity_schema())}});
  } else if (name == kFrameTransforms) {
    const Json transform = object("foxglove.FrameTransform", {{"timestamp", clock_schema("time")},
                                                              {"parent_frame_id", kString},
                                                              {"child_frame_id", kString},
                                                              {"translation", vector_schema("foxglove.Vector3")},
                                                              {"rotation", quaternion_schema()}});
    found = object(kFrameTransforms, {{"transforms", array(transform)}});
  } else if (name == kPointCloud) {
    const Json field =
        object("foxglove.PackedElementField", {{"name", kString}, {"offset", kInteger}, {"type", kInteger}});
    found = object(kPointCloud, {{"timestamp", clock_schema("time")},
                                 {"frame_id", kString},
                                 {"pose", pose_schema()},
                                 {"point_stride", kInteger},
                                 {"fields", array(field)},
                                 {"data", kBase64}});
  } else {
    throw std::invalid_argument("no schema of Foxglove's is known as '" + name + "'");
  }
  found["$schema"] = "https://json-schema.org/draft/2020-12/schema";
  return found;
}

Json time(Utime utime) {
  return json_of(utime.time_since_epoch());
}

Json transform(Utime utime, const std::string& parent, const std::string& child, const Pose& pose) {
  return {{"timestamp", time(utime)},
          {"parent_frame_id", parent},
          {"child_frame_id", child},
          {"translation", json_of(pose.position)},
          {"rotation", rotation(pose.yaw_rad)}};
}

Json cube(const Pose& pose, const Eigen::Vector3d& size_m, const Color& color) {
  return {{"pose", json_of(pose)}, {"size", json_of(size_m)}, {"color", json_of(color)}};
}

Json sphere(const Pose& pose, double diameter_m, const Color& color) {
  return cube(pose, Eigen::Vector3d::Constant(diameter_m), color);
}

Json cylinder(const Pose& pose, double diameter_m, double height_m, const Color& color) {
  Json json = cube(pose, {diameter_m, diameter_m, height_m}, color);
  json["bottom_scale"] = 1.0;
  json["top_scale"] = 1.0;
  return json;
}

Json line(const Pose& pose, std::span<const Eigen::Vector3d> points, bool closed, double thickness_m,
          const Color& color) {
  constexpr int kStrip = 0, kLoop = 1;
  Json json = {{"type", closed ? kLoop : kStrip}, {"pose", json_of(pose)},   {"thickness", thickness_m},
               {"scale_invariant", false},        {"points", Json::array()}, {"color", json_of(color)},
               {"colors", Json::array()},         {"indices", Json::array()}};
  for (const Eigen::Vector3d& point : points) json["points"].push_back(json_of(point));
  return json;
}

Json polygons(std::span<const std::vector<Eigen::Vector3d>> polygons, const Color& color) {
  Json points = Json::array(), indices = Json::array();
  for (const auto& polygon : polygons) {
    const std::size_t first = points.size();
    for (const Eigen::Vector3d& corner : polygon) points.push_back(json_of(corner));
    for (std::size_t i = 1; i + 1 < polygon.size(); ++i) {
      for (const std::size_t corner : {std::size_t{0}, i, i + 1}) indices.push_back(first + corner);
    }
  }
  return {{"pose", json_of(Pose{})},
          {"points", std::move(points)},
          {"color", json_of(color)},
          {"colors", Json::array()},
          {"indices", std::move(indices)}};
}

Json entity(Utime utime, const std::string& id, const std::string& frame, Duration lifetime) {
  Json json = {{"timestamp", time(utime)},
               {"frame_id", frame},
               {"id", id},
               {"lifetime", json_of(lifetime)},
               {"frame_locked", frame != "world"}};
  for (const char* name :
       {"metadata", "arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models"})
    json[name] = Json::array();
  return json;
}

Json deletion(Utime utime, const std::string& id) {
  constexpr int kMatchingId = 0;
  return {{"timestamp", time(utime)}, {"type", kMatchingId}, {"id", id}};
}

Json scene(Json entities, Json deletions) {
  return {{"deletions", std::move(deletions)}, {"entities", std::move(entities)}};
}

Json point_cloud(Utime utime, std::span<const Eigen::Vector4f> points) {
  constexpr int kFloat32 = 7;
  constexpr const char* kNames[] = {"x", "y", "z", "t"};
  Json fields = Json::array();
  for (const char* name : kNames)
    fields.push_back({{"name", name}, {"offset", sizeof(float) * fields.size()}, {"type", kFloat32}});
  std::vector<std::uint8_t> data;
  data.reserve(points.size() * sizeof(Eigen::Vector4f));
  for (const Eigen::Vector4f& point : points) {
    for (int i = 0; i < 4; ++i) {
      const auto bits = std::bit_cast<std::uint32_t>(point[i]);
      for (int shift = 0; shift < 32; shift += 8) data.push_back(static_cast<std::uint8_t>(bits >> shift));
    }
  }
  return {{"timestamp", time(utime)},    {"frame_id", "world"},
          {"pose", json_of(Pose{})},     {"point_stride", sizeof(float) * std::size(kNames)},
          {"fields", std::move(fields)}, {"data", base64(data)}};
}

std::string base64(std::span<const std::uint8_t> bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t here = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 3; ++k) word = word << 8 | (k < here ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) text += k <= here ? kDigits[word >> (18 - 6 * k) & 63u] : '=';
  }
  return text;
}

}  // namespace swarm::foxglove
