#include "swarm_sim/world/world_json.h"

#include <cmath>
#include <fstream>
#include <iterator>
#include <numbers>

#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/option_set.h"
#include "swarm_sim/world/json_value.h"

namespace swarm {
namespace {

using nlohmann::ordered_json;

constexpr double kFar_m = 1e4, kLarge_m = 1e3, kFast_mps = 100.0, kLate_s = 1e6;
constexpr std::size_t kMaxWorldObstacles = 4096, kMaxWalls = 4096, kMaxName = 100, kMaxPath = 4096;
constexpr auto kPositive = JsonValue::Low::kExcluded;

template <class Box>
Box read_box(const JsonValue& value) {
  value.expect_keys({"min", "max"});
  constexpr int kSize = decltype(Box::min)::RowsAtCompileTime;
  Box box;
  box.min = value.at("min").numbers(kSize, -kFar_m, kFar_m);
  box.max = value.at("max").numbers(kSize, -kFar_m, kFar_m);
  if (!(box.min.array() < box.max.array()).all()) value.fail("a box with min below max along every axis");
  return box;
}

// Accelerations by axes, or by thrust.
MotionLimits read_limits(const JsonValue& value) {
  value.expect_keys({"speed", "acceleration", "jerk", "thrust"});
  MotionLimits limits;
  limits.v_max_mps = value.at("speed").number(0.0, kFast_mps, kPositive);
  if (const auto jerk = value.find("jerk")) limits.j_max_mps3 = jerk->number(0.0, 1e5, kPositive);
  const auto thrust = value.find("thrust");
  if (!thrust) {
    limits.a_max_mps2 = value.at("acceleration").number(0.0, 1000.0, kPositive);
    return limits;
  }
  if (const auto acceleration = value.find("acceleration")) acceleration->fail("absent where there is thrust");
  thrust->expect_keys({"min", "max", "tilt"});
  limits.kind = "thrust";
  limits.thrust = {thrust->at("min").number(0.0, 9.8), thrust->at("max").number(9.82, 1000.0),
                   thrust->at("tilt").number(1.0, 80.0)};
  try {
    verify(limits);
  } catch (const OptionError&) {
    thrust->fail("more than gravity, 9.81 m/s^2, upwards when tilted");
  }
  return limits;
}

Waypoint read_waypoint(const JsonValue& value) {
  value.expect_keys({"position", "tolerance", "speed", "wait"});
  Waypoint waypoint;
  waypoint.position = value.at("position").numbers(3, -kFar_m, kFar_m);
  if (const auto tolerance = value.find("tolerance"))
    waypoint.tolerance_m = tolerance->number(0.0, kMaxTolerance_m, kPositive);
  if (const auto speed = value.find("speed")) waypoint.speed_mps = speed->number(kLeastSpeed_mps, kFast_mps);
  if (const auto wait = value.find("wait")) waypoint.wait = to_duration(wait->number(0.0, kMaxWait_s));
  return waypoint;
}

WorldRobot read_robot(const JsonValue& value) {
  value.expect_keys({"id", "start", "goal", "goals", "radius", "limits"});
  WorldRobot robot;
  robot.id = value.at("id").integer(0, kMaxRobotId);
  robot.start = value.at("start").numbers(3, -kFar_m, kFar_m);
  if (const auto goals = value.find("goals")) {
    if (const auto goal = value.find("goal")) goal->fail("absent where there are goals");
    const std::vector<JsonValue> items = goals->items();
    if (items.empty() || items.size() > kMaxWaypoints) goals->fail("an array of 1 to 1000 goals");
    robot.mission.clear();
    for (const JsonValue& item : items) robot.mission.push_back(read_waypoint(item));
  } else if (const auto goal = value.find("goal")) {
    robot.mission[0].position = goal->numbers(3, -kFar_m, kFar_m);
  } else {
    robot.is_told = true;
    robot.mission[0].position = robot.start;
  }
  robot.radius_m = value.at("radius").number(0.0, 10.0, kPositive);
  if (const auto limits = value.find("limits")) robot.limits = read_limits(*limits);
  return robot;
}

Shape read_shape(const JsonValue& value) {
  const std::string name = value.at("shape").text(kMaxName);
  const auto length = [&](const char* key) { return value.at(key).number(0.0, kLarge_m, kPositive); };
  Shape shape;
  if (name == "column") {
    value.expect_keys({"shape", "center", "diameter", "height", "velocity", "acceleration", "track", "bounds"});
    shape.kind = Shape::Kind::kColumn;
    shape.size = {length("diameter"), length("height"), 0.0};
  } else if (name == "ring") {
    value.expect_keys({"shape", "center", "radius", "width", "yaw", "velocity", "acceleration", "track", "bounds"});
    shape.kind = Shape::Kind::kRing;
    shape.size = {length("radius"), length("width"), 0.0};
    if (shape.size.y() > 2.0 * shape.size.x()) value.at("width").fail("at most twice the ring's radius");
  } else if (name == "box") {
    value.expect_keys({"shape", "center", "size", "yaw", "velocity", "acceleration", "track", "bounds"});
    shape.kind = Shape::Kind::kBox;
    shape.size = value.at("size").numbers(3, 0.0, kLarge_m, kPositive);
  } else if (name == "sphere") {
    value.expect_keys({"shape", "center", "diameter", "velocity", "acceleration", "track", "bounds"});
    shape.kind = Shape::Kind::kSphere;
    shape.size = {length("diameter"), 0.0, 0.0};
  } else {
    value.at("shape").fail("one of column, ring, box, sphere");
  }
  if (const auto yaw = value.find("yaw")) shape.yaw_rad = yaw->number(-2.0 * std::numbers::pi, 2.0 * std::numbers::pi);
  if (std::abs(shape.yaw_rad) > std::numbers::pi) shape.yaw_rad = std::remainder(shape.yaw_rad, 2.0 * std::numbers::pi);
  return shape;
}

std::vector<TrackPoint> read_track(const JsonValue& value) {
  std::vector<TrackPoint> track;
  for (const JsonValue& item : value.items()) {
    const Eigen::Vector3d point = item.numbers(3, -kLate_s, kLate_s);
    if (point.tail<2>().cwiseAbs().maxCoeff() > kFar_m) item.fail("(t, x, y) with x and y in [-10000, 10000]");
    track.push_back({point.x(), point.tail<2>()});
  }
  if (track.size() < 2) value.fail("an array of at least two points (t, x, y)");
  return track;
}

WorldObstacle read_obstacle(const JsonValue& value) {
  WorldObstacle obstacle;
  value.require_object();
  obstacle.shape = read_shape(value);
  const bool column = obstacle.shape.kind == Shape::Kind::kColumn;
  const auto track = value.find("track");
  const auto center = value.find("center");
  if (track) obstacle.track = read_track(*track);
  if (column) obstacle.center.z() = 0.5 * obstacle.shape.size.y();
  if (track) obstacle.center.head<2>() = obstacle.track.front().position;
  if (center && column && center->items().size() == 2) {
    obstacle.center.head<2>() = center->numbers(2, -kFar_m, kFar_m);
  } else if (center || !track || !column) {
    obstacle.center = value.at("center").numbers(3, -kFar_m, kFar_m);
  }
  if (track && obstacle.center.head<2>() != obstacle.track.front().position)
    center->fail("at the first point of the track");
  if (const auto velocity = value.find("velocity")) {
    if (track) velocity->fail("absent: the track tells the motion");
    obstacle.velocity_mps = velocity->numbers(2, -kFast_mps, kFast_mps);
  }
  if (const auto acceleration = value.find("acceleration")) {
    if (track) acceleration->fail("absent: the track tells the motion");
    obstacle.acceleration_mps2 = acceleration->number(0.0, kMaxObstacleAcceleration_mps2);
  }
  if (const auto bounds = value.find("bounds")) {
    if (track) bounds->fail("absent: the track tells the motion");
    obstacle.bounds = read_box<Rectangle>(*bounds);
  }
  return obstacle;
}

// The flight's options that a world may bring, under their names on the command line.
void read_options(const JsonValue& value, World* world) {
  std::vector<const char*> names;
  const auto read =
      Overloaded{[&](const char* name, double& number, double low, double high, const char*, const char*) {
                   names.push_back(name);
                   if (const auto found = value.find(name)) number = found->number(low, high);
                 },
                 [&](const char* name, std::string& word, std::span<const char* const> words, const char*) {
                   names.push_back(name);
                   const auto found = value.find(name);
                   if (!found) return;
                   word = found->text(kMaxName);
                   if (std::ranges::find(words, word) == words.end()) found->fail(listed(words));
                 },
                 [&](const char* name, std::string& text, void (*check)(const std::string&), const char*) {
                   names.push_back(name);
                   const auto found = value.find(name);
                   if (!found) return;
                   try {
                     check(text = found->text(kMaxName));
                   } catch (const OptionError& error) {
                     found->fail(std::string(error.what()).substr(std::string_view("must be ").size()));
                   }
                 }};
  value.require_object();
  for_each_vehicle_option(world->vehicle, read);
  for_each_sensor_option(world->sensor, read);
  value.expect_keys(names);
}

World read_values(const JsonValue& value, const std::filesystem::path& directory) {
  value.expect_keys({"name", "space", "obstacle_bounds", "limits", "sensing_radius", "static_map", "walls", "options",
                     "robots", "obstacles"});
  World world;
  world.name = value.at("name").text(kMaxName);
  world.space = read_box<Space>(value.at("space"));
  world.obstacle_bounds = {world.space.min.head<2>(), world.space.max.head<2>()};
  if (const auto bounds = value.find("obstacle_bounds")) world.obstacle_bounds = read_box<Rectangle>(*bounds);
  world.limits = read_limits(value.at("limits"));
  if (const auto radius = value.find("sensing_radius"))
    world.sensing_radius_m = radius->number(0.0, kLarge_m, kPositive);
  if (const auto map = value.find("static_map")) {
    world.static_map = (std::filesystem::current_path() / directory / map->text(kMaxPath)).lexically_normal();
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(world.static_map, ignored))
      map->fail("an existing file, relative to the world file");
  }
  if (const auto walls = value.find("walls")) {
    if (!world.static_map.empty()) walls->fail("absent where there is a static_map");
    if (walls->items().size() > kMaxWalls) walls->fail("an array of at most 4096 walls");
    for (const JsonValue& item : walls->items()) world.walls.push_back(read_box<Space>(item));
  }
  if (const auto options = value.find("options")) read_options(*options, &world);
  const JsonValue robots = value.at("robots"), obstacles = value.at("obstacles");
  for (const JsonValue& item : robots.items()) world.robots.push_back(read_robot(item));
  if (obstacles.items().size() > kMaxWorldObstacles) obstacles.fail("an array of at most 4096 obstacles");
  for (const JsonValue& item : obstacles.items()) world.obstacles.push_back(read_obstacle(item));
  return world;
}

ordered_json array(const Eigen::Ref<const Eigen::VectorXd>& values) {
  return std::vector<double>(values.begin(), values.end());
}

ordered_json to_json(const Space& box) {
  return {{"min", array(box.min)}, {"max", array(box.max)}};
}

ordered_json to_json(const MotionLimits& limits) {
  ordered_json json = {{"speed", limits.v_max_mps}};
  if (limits.limits_thrust()) {
    const auto& [least_mps2, most_mps2, tilt_deg] = limits.thrust;
    json["thrust"] = {{"min", least_mps2}, {"max", most_mps2}, {"tilt", tilt_deg}};
  } else {
    json["acceleration"] = limits.a_max_mps2;
  }
  if (limits.limits_jerk()) json["jerk"] = limits.j_max_mps3;
  return json;
}

ordered_json to_json(const Waypoint& waypoint) {
  ordered_json json{{"position", array(waypoint.position)}};
  const Waypoint usual;
  if (waypoint.tolerance_m != usual.tolerance_m) json["tolerance"] = waypoint.tolerance_m;
  if (waypoint.speed_mps != usual.speed_mps) json["speed"] = waypoint.speed_mps;
  if (waypoint.wait != usual.wait) json["wait"] = to_seconds(waypoint.wait);
  return json;
}

ordered_json to_json(const WorldRobot& robot) {
  ordered_json json{{"id", robot.id}, {"start", array(robot.start)}};
  if (robot.is_told) {
    // No goal of its own.
  } else if (robot.has_one_goal()) {
    json["goal"] = array(robot.goal());
  } else {
    for (const Waypoint& waypoint : robot.mission) json["goals"].push_back(to_json(waypoint));
  }
  json["radius"] = robot.radius_m;
  if (robot.limits) json["limits"] = to_json(*robot.limits);
  return json;
}

ordered_json to_json(const WorldObstacle& obstacle) {
  const Shape& shape = obstacle.shape;
  const bool column = shape.kind == Shape::Kind::kColumn;
  const bool on_ground = column && obstacle.center.z() == 0.5 * shape.size.y();
  static constexpr const char* kNames[] = {"column", "ring", "box", "sphere"};
  ordered_json json{{"shape", kNames[static_cast<int>(shape.kind)]}};
  if (!on_ground) json["center"] = array(obstacle.center);
  if (on_ground && obstacle.track.empty()) json["center"] = array(obstacle.center.head<2>());
  switch (shape.kind) {
    case Shape::Kind::kColumn:
      json.update({{"diameter", shape.size.x()}, {"height", shape.size.y()}});
      break;
    case Shape::Kind::kRing:
      json.update({{"radius", shape.size.x()}, {"width", shape.size.y()}, {"yaw", shape.yaw_rad}});
      break;
    case Shape::Kind::kBox:
      json.update({{"size", array(shape.size)}, {"yaw", shape.yaw_rad}});
      break;
    default:
      json["diameter"] = shape.size.x();
      break;
  }
  if (obstacle.track.empty()) {
    json["velocity"] = array(obstacle.velocity_mps);
    if (obstacle.acceleration_mps2 != 0.0) json["acceleration"] = obstacle.acceleration_mps2;
    if (obstacle.bounds) json["bounds"] = {{"min", array(obstacle.bounds->min)}, {"max", array(obstacle.bounds->max)}};
  } else {
    for (const TrackPoint& point : obstacle.track)
      json["track"].push_back({point.t_s, point.position.x(), point.position.y()});
  }
  return json;
}

// Those that differ from the usual.
ordered_json options_of(const World& world) {
  const World usual_world;
  ordered_json usual = ordered_json::object(), options = ordered_json::object();
  const auto write_to = [](ordered_json* json) {
    return [json](const char* name, const auto& value, const auto&...) { (*json)[name] = value; };
  };
  for_each_vehicle_option(usual_world.vehicle, write_to(&usual));
  for_each_sensor_option(usual_world.sensor, write_to(&usual));
  for_each_vehicle_option(world.vehicle, write_to(&options));
  for_each_sensor_option(world.sensor, write_to(&options));
  for (const auto& [name, value] : usual.items()) {
    if (options[name] == value) options.erase(name);
  }
  return options;
}

template <class Item>
std::string lines(const std::vector<Item>& items) {
  std::string text = "[";
  for (std::size_t i = 0; i < items.size(); ++i) text += (i == 0 ? "\n  " : ",\n  ") + to_json(items[i]).dump();
  return text + "]";
}

}  // namespace

World parse_world(const std::string& text, const std::string& source, const std::filesystem::path& directory) try {
  const nlohmann::json document = parse_json(text);
  World world = read_values(JsonValue(document), directory);
  check_world(world);
  return world;
} catch (const WorldError& error) {
  throw WorldError(source + ": " + error.what());
}

World read_world(const std::filesystem::path& path) {
  std::error_code ignored;
  std::ifstream in(path, std::ios::binary);
  if (!in || std::filesystem::is_directory(path, ignored))
    throw WorldError(path.string() + ": must be a readable world file");
  return parse_world({std::istreambuf_iterator<char>(in), {}}, path.string(), path.parent_path());
}

std::string to_json_text(const World& world, const std::filesystem::path& directory) {
  const auto box = [](const auto& b) { return ordered_json{{"min", array(b.min)}, {"max", array(b.max)}}.dump(); };
  std::string text = "{\"name\": " + ordered_json(world.name).dump();
  text += ",\n \"space\": " + box(world.space);
  text += ",\n \"obstacle_bounds\": " + box(world.obstacle_bounds);
  text += ",\n \"limits\": " + to_json(world.limits).dump();
  text += ",\n \"sensing_radius\": " + ordered_json(world.sensing_radius_m).dump();
  if (!world.static_map.empty()) {
    const auto base = (std::filesystem::current_path() / directory).lexically_normal();
    text += ",\n \"static_map\": " + ordered_json(world.static_map.lexically_proximate(base).string()).dump();
  }
  if (!world.walls.empty()) text += ",\n \"walls\": " + lines(world.walls);
  if (const ordered_json options = options_of(world); !options.empty()) text += ",\n \"options\": " + options.dump();
  text += ",\n \"robots\": " + lines(world.robots);
  return text + ",\n \"obstacles\": " + lines(world.obstacles) + "}\n";
}

}  // namespace swarm
