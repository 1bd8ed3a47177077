// What simulated depth cameras and LiDARs say: on the wire, of walls and edges, and of where they are.
#include "swarm_sim/environment/range_sensor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "lcmtypes/bus/codec.h"
#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using sogm_swarm::depth_image_t;
using sogm_swarm::lidar_scan_t;

// A room without walls but one, right across: its face is at x = 6.
World walled_world(const std::string& kind) {
  World world;
  world.name = "walled";
  world.sensor.kind = kind;
  WorldObstacle& wall = world.obstacles.emplace_back();
  wall.shape = {.kind = Shape::Kind::kBox, .size = {2, 100, 100}};
  wall.center = {7, 0, 0};
  return world;
}

template <class Message>
std::vector<std::uint8_t> bytes_of(Message message) {
  message.header.schema_version = sogm_swarm::header_t::kSchemaVersion;
  message.header.utime = to_us(kStart);
  std::vector<std::uint8_t> bytes;
  encode(message, &bytes);
  EXPECT_EQ(decode(bytes, &message), Refusal::kNone);
  return bytes;
}

template <class Message>
Pose pose_of(const Message& message) {
  const double(&q)[4] = message.orientation;
  return {Eigen::Vector3d(message.position), Eigen::Quaterniond(q[0], q[1], q[2], q[3])};
}

// The points of a message in the world.
std::vector<Eigen::Vector3d> points_of(const depth_image_t& image) {
  const Pose pose = pose_of(image);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < image.num_pixels; ++i) {
    const double depth_m = 1e-3 * image.depth_mm[static_cast<std::size_t>(i)];
    const int row = i / image.width;
    const Eigen::Vector3d ahead((i % image.width - double{image.center_px[0]}) / double{image.focal_px[0]},
                                (row - double{image.center_px[1]}) / double{image.focal_px[1]}, 1.0);
    if (depth_m > 0.0) points.push_back(pose.position + pose.orientation * (depth_m * ahead));
  }
  return points;
}
std::vector<Eigen::Vector3d> points_of(const std::vector<lidar_scan_t>& parts) {
  std::vector<Eigen::Vector3d> points;
  for (const lidar_scan_t& part : parts) {
    const Pose pose = pose_of(part);
    for (std::size_t i = 0; i < part.coordinates.size(); i += 3) {
      const auto* const c = &part.coordinates[i];
      points.push_back(pose.position + pose.orientation * (0.005 * Eigen::Vector3d(c[0], c[1], c[2])));
    }
  }
  return points;
}

// One sensor that is where it takes itself to be.
class Looker {
 public:
  explicit Looker(const World& world, int robot_id = 0)
      : world_(world), sensor(world_, robot_id), caster_(world_, nullptr) {}
  std::vector<lidar_scan_t> scan(double t_s = 0.0) { return sensor.scan(caster_, balls, t_s, pose, pose); }
  depth_image_t image(double t_s = 0.0) { return sensor.images(caster_, balls, t_s, pose, pose).at(0); }
  std::vector<Eigen::Vector3d> points() {
    return world_.sensor.kind == "lidar" ? points_of(scan()) : points_of(image());
  }

 private:
  World world_;

 public:
  RangeSensors sensor;
  Pose pose{{1.5, 0.5, 1.0}, attitude_of({1.5, -0.5, 0}, 0.3)};
  std::vector<RayCaster::Ball> balls;

 private:
  RayCaster caster_;
};

TEST(RangeSensor, MessagesAreAsTheWireWantsThem) {
  Looker depth(walled_world("depth")), lidar(walled_world("lidar"));
  const depth_image_t image = depth.image();
  bytes_of(image);
  EXPECT_EQ(std::ssize(image.depth_mm), image.num_pixels);
  EXPECT_EQ(image.num_pixels, 160 * 120);
  const std::vector<lidar_scan_t> parts = lidar.scan();
  EXPECT_GT(parts.size(), 1u);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    bytes_of(parts[i]);
    EXPECT_EQ(parts[i].part, static_cast<int>(i));
    EXPECT_EQ(parts[i].num_parts, std::ssize(parts));
    EXPECT_EQ(std::ssize(parts[i].coordinates), parts[i].num_coordinates);
  }
}

// Three messages one after the other.
std::vector<std::vector<std::uint8_t>> said(const World& world, int robot_id) {
  Looker looker(world, robot_id);
  std::vector<std::vector<std::uint8_t>> all;
  for (const double t_s : {0.0, 0.1, 0.2}) {
    if (world.sensor.kind == "depth") all.push_back(bytes_of(looker.image(t_s)));
    if (world.sensor.kind == "lidar")
      for (const lidar_scan_t& part : looker.scan(t_s)) all.push_back(bytes_of(part));
  }
  return all;
}

TEST(RangeSensor, TheSameRobotOfTheSameWorldMeasuresTheSame) {
  for (const char* kind : {"depth", "lidar"}) {
    SCOPED_TRACE(kind);
    World world = walled_world(kind);
    world.sensor.pose_noise_m = 0.02, world.sensor.pose_noise_deg = 0.5;
    const auto first = said(world, 3);
    EXPECT_TRUE(said(world, 3) == first);
    EXPECT_FALSE(said(world, 4) == first);
    EXPECT_FALSE(first[0] == first[first.size() / 3]);
    world.name = "another";
    EXPECT_FALSE(said(world, 3) == first);
  }
}

// Along its ray, in standard deviations.
void expect_on_wall(const std::string& kind, double noise_m, double noise_per_m) {
  SCOPED_TRACE(kind);
  Looker looker(walled_world(kind));
  const Eigen::Vector3d from = looker.pose.position;
  double sum = 0.0, squares = 0.0;
  int count = 0, far_off = 0;
  for (int k = 0; k < 3; ++k) {
    for (const Eigen::Vector3d& point : looker.points()) {
      const Eigen::Vector3d way = (point - from).normalized();
      if ((point - from).norm() > 8.0) continue;  // where neighbouring rays are far apart, they mix
      const double length_m = (6.0 - from.x()) / way.x();
      const double error = ((point - from).norm() - length_m) / (noise_m + noise_per_m * length_m * length_m);
      sum += error, squares += error * error, ++count;
      far_off += std::abs(error) > 5.0 ? 1 : 0;
    }
  }
  EXPECT_GT(count, 3000);
  EXPECT_NEAR(sum / count, 0.0, 0.05);
  EXPECT_NEAR(std::sqrt(squares / count), 1.0, 0.03);
  EXPECT_EQ(far_off, 0) << "of " << count;
}

TEST(RangeSensor, PointsLieOnTheWallAsFarAsTheyAreNoisy) {
  expect_on_wall("depth", 0.005, 0.0015);
  expect_on_wall("lidar", 0.02, 0.0);
}

TEST(RangeSensor, TwoPercentOfTheRaysAreLost) {
  Looker depth(walled_world("depth")), lidar(walled_world("lidar"));
  std::size_t pixels = 0, points = 0;
  for (int k = 0; k < 4; ++k) pixels += depth.points().size(), points += lidar.points().size();
  EXPECT_NEAR(static_cast<double>(pixels) / (4 * 160 * 120), 0.98, 0.003);
  EXPECT_NEAR(static_cast<double>(points) / (4 * 16 * 900), 0.98, 0.003);
}

// Rays that meet nothing are told as far away as the sensor sees; what is too near is not told.
TEST(RangeSensor, KeepsItsRange) {
  for (const std::string kind : {"depth", "lidar"}) {
    SCOPED_TRACE(kind);
    World world = walled_world(kind);
    world.obstacles.clear();
    Looker looker(world);
    const double range_m = kind == "depth" ? 20.0 : 40.0, least_m = kind == "depth" ? 0.3 : 0.1;
    const std::vector<Eigen::Vector3d> far = looker.points();
    for (const Eigen::Vector3d& point : far) ASSERT_NEAR((point - looker.pose.position).norm(), range_m, 0.006);
    const auto look_at_ball = [&](double away_m) {  // the distances of points on it
      looker.balls = {{looker.pose.position + looker.pose.orientation * Eigen::Vector3d(away_m + 0.3, 0, 0), 0.3}};
      std::vector<double> distances;
      for (const Eigen::Vector3d& point : looker.points()) distances.push_back((point - looker.pose.position).norm());
      std::erase_if(distances, [](double distance_m) { return distance_m > 2.0; });
      std::ranges::sort(distances);
      return distances;
    };
    const std::vector<double> seen = look_at_ball(1.0), too_near = look_at_ball(0.8 * least_m);
    EXPECT_GT(seen.size(), 100u);
    EXPECT_NEAR(seen.at(0), 1.0, 0.1);
    EXPECT_GT(too_near.size(), 100u);  // the sides of it are further away
    EXPECT_GT(too_near.at(0), least_m - 0.005);
  }
}

// Columns and a robot before a wall: nearly all points are on one of them, some are mixed of two, none is before both.
TEST(RangeSensor, RaysMixAtEdgesOnly) {
  for (const char* kind : {"depth", "lidar"}) {
    SCOPED_TRACE(kind);
    World world = walled_world(kind);
    for (const double y : {-1.0, 0.0, 1.5}) {
      WorldObstacle& column = world.obstacles.emplace_back();
      column.shape = {.kind = Shape::Kind::kColumn, .size = {0.5, 1.8, 0}};
      column.center = {4, y, 0.9};
    }
    Looker looker(world);
    looker.balls = {{{3, 1.2, 1.2}, 0.2}};
    int count = 0, on_robot = 0, off = 0;
    for (const Eigen::Vector3d& point : looker.points()) {
      if (point.x() < 2.0 || (point - looker.pose.position).norm() > 7.0) continue;
      const double to_robot_m = (point - looker.balls[0].center).norm() - 0.2;
      double least_m = std::min(std::abs(to_robot_m), std::abs(point.x() - 6.0));
      for (const WorldObstacle& obstacle : world.obstacles)
        least_m = std::min(least_m, distance(obstacle.shape, point - obstacle.center));
      ++count;
      off += least_m > 0.15 ? 1 : 0;
      on_robot += std::abs(to_robot_m) < 0.05 ? 1 : 0;
      EXPECT_GT(point.x(), 2.7);
    }
    EXPECT_GT(count, 1000);
    EXPECT_GT(on_robot, 10);
    EXPECT_LT(off, 0.03 * count);
    EXPECT_GT(off, 0.001 * count);
  }
}

// z of a camera is ahead, x to the right, y down; a body's x is ahead, y to the left, z up.
const Eigen::Quaterniond kCameraOnBody(0.5, -0.5, 0.5, -0.5);

// Where it takes itself to be is what it says; what it sees is as it is.
TEST(RangeSensor, SaysWhereItTakesItselfToBe) {
  const Pose truth{{0, 0, 1}, attitude_of({0, 0, 0}, 0.1)}, believed{{0.1, -0.2, 1.3}, attitude_of({1, 2, 0}, -2.0)};
  World world = walled_world("lidar"), wrong = world;
  wrong.sensor.pose_noise_m = 0.05;
  RayCaster caster(world, nullptr);
  const auto as_it_is = RangeSensors(world, 1).scan(caster, {}, 0.0, truth, truth);
  const auto exact = RangeSensors(world, 1).scan(caster, {}, 0.0, truth, believed);
  const auto err = RangeSensors(wrong, 1).scan(caster, {}, 0.0, truth, believed);
  for (std::size_t i = 0; i < exact.size(); ++i) {
    EXPECT_EQ(pose_of(exact[i]).position, believed.position);
    EXPECT_LT(pose_of(exact[i]).orientation.angularDistance(believed.orientation), 1e-9);
    EXPECT_NE(pose_of(err[i]).position, believed.position);
    EXPECT_EQ(pose_of(err[i]).position, pose_of(err[0]).position) << "all parts are of one scan";
    EXPECT_EQ(exact[i].coordinates, as_it_is[i].coordinates);
    EXPECT_EQ(err[i].coordinates, as_it_is[i].coordinates);
  }
  world.sensor.kind = "depth";
  const depth_image_t image = RangeSensors(world, 1).images(caster, {}, 0.0, truth, believed).at(0);
  EXPECT_EQ(image.depth_mm, RangeSensors(world, 1).images(caster, {}, 0.0, truth, truth).at(0).depth_mm);
  EXPECT_EQ(pose_of(image).position, believed.position);
  EXPECT_LT(pose_of(image).orientation.angularDistance(believed.orientation * kCameraOnBody), 1e-9);
}

// Each sensor of several sees what is before it, and says how it is turned.
TEST(RangeSensor, SeveralSitOnTheRobotAsTheyShall) {
  World world = walled_world("depth");
  world.sensor.mounts = "0,180:30:-0.2:0.1:0.05";
  world.sensor.pose_noise_m = 0.02;
  RayCaster caster(world, nullptr);
  const Pose body{{1, -2, 1}, attitude_of({0, 0, 0}, 0.5)};
  const auto images = RangeSensors(world, 1).images(caster, {}, 0.0, body, body);
  ASSERT_EQ(images.size(), 2u);
  for (std::size_t i = 0; i < images.size(); ++i) {
    bytes_of(images[i]);
    EXPECT_EQ(images[i].sensor, static_cast<int>(i));
    for (const Eigen::Vector3d& point : points_of(images[i])) EXPECT_LT(point.cwiseAbs().maxCoeff(), 30.0);
  }
  const Pose ahead = pose_of(images[0]), behind = pose_of(images[1]);
  const Eigen::Vector3d z = Eigen::Vector3d::UnitZ(), x = body.orientation * Eigen::Vector3d::UnitX();
  EXPECT_NEAR((ahead.orientation * z).dot(x), 1.0, 1e-9) << "cameras look along z";
  EXPECT_NEAR((behind.orientation * z).dot(x), -std::cos(std::numbers::pi / 6), 1e-9);
  EXPECT_NEAR((behind.orientation * z).z(), -0.5, 1e-9) << "downwards";
  const Eigen::Vector3d apart = body.orientation.inverse() * (behind.position - ahead.position);
  EXPECT_LT((apart - Eigen::Vector3d(-0.2, 0.1, 0.05)).norm(), 1e-9) << "they err as one: " << apart.transpose();
  world.sensor.kind = "lidar";
  const auto parts = RangeSensors(world, 1).scan(caster, {}, 0.0, body, body);
  ASSERT_EQ(parts.size(), 4u);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    EXPECT_EQ(parts[i].sensor, static_cast<int>(i / 2));
    EXPECT_EQ(parts[i].part, static_cast<int>(i % 2));
    EXPECT_EQ(parts[i].num_parts, 2);
  }
}

TEST(RangeSensor, MountsThatMakeNoSenseAreRefused) {
  EXPECT_EQ(parse_mounts("").size(), 1u);
  const auto mounts = parse_mounts("-90,0:90,10:-20:0.1:-0.2:0.3");
  ASSERT_EQ(mounts.size(), 3u);
  EXPECT_EQ(mounts[0].yaw_deg, -90.0);
  EXPECT_EQ(mounts[1].pitch_deg, 90.0);
  EXPECT_EQ(mounts[2].position, Eigen::Vector3d(0.1, -0.2, 0.3));
  for (const char* text : {",", "0,", "x", "0:", "0:1:2", "0:1:2:3", "0:1:2:2:2:2", "181", "0:0:2.1:0:0", "nan", "1 2",
                           "0,0,0,0,0,0,0,0,0"})
    EXPECT_THROW(parse_mounts(text), OptionError) << text;
}

// Each axis by as much as it shall, and smoothly: in a tenth of a second by a third of that.
TEST(RangeSensor, PosesErrAsMuchAsTheyShall) {
  World world = walled_world("depth");
  world.obstacles.clear();
  world.sensor.pose_noise_m = 0.05, world.sensor.pose_noise_deg = 2.0;
  constexpr int kRobots = 200;
  double place2 = 0.0, change2 = 0.0, turn2 = 0.0;
  for (int id = 0; id < kRobots; ++id) {
    Looker looker(world, id);
    const Pose right = looker.pose;
    const Pose before = pose_of(looker.image(2.0)), after = pose_of(looker.image(2.1));
    place2 += (before.position - right.position).squaredNorm() / (3 * kRobots);
    change2 += (after.position - before.position).squaredNorm() / (3 * kRobots);
    const Eigen::AngleAxisd turn(before.orientation * (right.orientation * kCameraOnBody).inverse());
    turn2 += turn.angle() * turn.angle() / (3 * kRobots);
  }
  EXPECT_NEAR(std::sqrt(place2), 0.05, 0.005);
  EXPECT_NEAR(std::sqrt(change2), 0.016, 0.008);
  EXPECT_NEAR(std::sqrt(turn2) * 180.0 / std::numbers::pi, 2.0, 0.2);
}

TEST(RangeSensor, LooksAsOftenAsItShall) {
  World world = walled_world("lidar");
  world.sensor.rate_hz = 25.0;
  EXPECT_EQ(RangeSensors(world, 0).period(), 100ms);
  world.sensor.kind = "depth";
  EXPECT_EQ(RangeSensors(world, 0).period(), 40ms);
}

// Rotors push along z; x is where the robot looks to, as far as it is not tilted.
TEST(RangeSensor, BodiesTiltToAccelerate) {
  Rng rng(1);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d acceleration = in_cube(rng, 5.0);
    const double yaw = uniform(rng, -3.1, 3.1);
    const Eigen::Matrix3d axes = attitude_of(acceleration, yaw).toRotationMatrix();
    SCOPED_TRACE(testing::Message() << acceleration.transpose() << " yaw " << yaw);
    EXPECT_LT(axes.col(2).cross(acceleration + Eigen::Vector3d(0, 0, 9.81)).norm(), 1e-9);
    EXPECT_GT(axes(2, 2), 0.0);
    EXPECT_GT(axes.col(0).dot(Eigen::Vector3d(std::cos(yaw), std::sin(yaw), 0)), 0.5);
    EXPECT_NEAR(axes.col(1).dot(Eigen::Vector3d(std::cos(yaw), std::sin(yaw), 0)), 0.0, 1e-9);
    EXPECT_NEAR(axes.determinant(), 1.0, 1e-9);
  }
}

}  // namespace
}  // namespace swarm
