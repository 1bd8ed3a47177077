// How well perception tracks people-like columns from a simulated depth camera or LiDAR, and how long a scan takes it
// and, of the same points, an OctoMap:
//   perception_bench lidar|depth [--pose-noise-m M] [--pose-noise-deg D] ...
#include <malloc.h>
#include <octomap/OcTree.h>
#include <time.h>

#include <algorithm>
#include <iostream>
#include <numbers>

#include "lcmtypes/bus/crc32.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/portable_math.h"
#include "lcmtypes/bus/text.h"
#include "lcmtypes/bus/timing_stats.h"
#include "map_daemon/perception/perception.h"
#include "swarm_sim/environment/range_sensor.h"

namespace swarm {
namespace {

struct Options {
  std::string sensor = "lidar";
  int obstacles = 15, worlds = 5, octomap = 20;
  double duration_s = 20.0, noise_m = 0.0, noise_deg = 0.0, speed_mps = 1.0, circle_mps = 1.5, diameter_m = 0.45;
  double pose_m = 0.01, pose_rad = 0.005, acceleration_mps2 = 0.5;
  bool explores = true;
};

struct Sample {
  std::vector<double> position_m, velocity_mps, latency_s, scan_ms, octomap_ms;
  int due = 0, missed = 0, scans = 0;
  int false_moving = 0, false_unseen = 0;             // the second: of the first, those that this scan did not see
  std::int64_t marked = 0, of_columns = 0, both = 0;  // points: as moving, of columns, which all move
  double perception_mb = 0.0;                         // what it has taken from the heap at the end of a flight
  std::uint32_t digest = 0;                           // of all reports and of all that was seen
};

// Of this thread: others may be at work beside it.
double processor_ms() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

// A change that changes no result leaves this as it is.
void digest(const Perception& perception, Sample* sample) {
  std::vector<std::uint8_t> report;
  encode(perception.report(), &report);
  const std::span words(perception.seen_space().words());
  const std::span seen(reinterpret_cast<const std::uint8_t*>(words.data()), words.size_bytes());
  sample->digest = crc32(seen, crc32(report, sample->digest));
}

World world_of(const Options& options, int number) {
  World world;
  world.name = "perception " + std::to_string(number);
  world.obstacle_bounds = {{-7, -7}, {7, 7}};
  world.sensor.kind = options.sensor;
  world.sensor.pose_noise_m = options.noise_m;
  world.sensor.pose_noise_deg = options.noise_deg;
  Random random(seed_of(world.name));
  for (int i = 0; i < options.obstacles; ++i) {
    WorldObstacle obstacle;
    obstacle.shape = {.kind = Shape::Kind::kColumn, .size = {options.diameter_m, 1.8, 0.0}};
    obstacle.center = {14.0 * random.uniform() - 7.0, 14.0 * random.uniform() - 7.0, 0.9};
    const auto [sin, cos] = sin_cos(2.0 * std::numbers::pi * random.uniform());
    obstacle.velocity_mps = options.speed_mps * Eigen::Vector2d(cos, sin);
    world.obstacles.push_back(obstacle);
  }
  return world;
}

// How long it takes an OctoMap to take the points of a scan, as far as perception looks.
double octomap_ms(const RangeScan& whole, double range_m, octomap::OcTree* tree) {
  octomap::Pointcloud cloud;
  const octomap::point3d origin(float(whole.origin.x()), float(whole.origin.y()), float(whole.origin.z()));
  for (const Eigen::Vector3d& place : whole.surfaces)
    cloud.push_back(float(place.x()), float(place.y()), float(place.z()));
  const double begun = processor_ms();
  tree->insertPointCloud(cloud, origin, range_m);
  return processor_ms() - begun;
}

// Memory that this process has taken from the heap [MB].
double heap_mb() {
  const auto info = ::mallinfo2();
  return 1e-6 * static_cast<double>(info.uordblks + info.hblkhd);
}

void fly(const Options& options, int number, Sample* sample) {
  const World world = world_of(options, number);
  RangeSensors sensor(world, 0);
  RayCaster caster(world, nullptr);
  PerceptionConfig config;
  config.explores = options.explores;
  config.pose_m = options.pose_m;
  config.pose_rad = options.pose_rad;
  config.tracks.acceleration_mps2 = options.acceleration_mps2;
  const double heap_before_mb = heap_mb();
  Perception perception(config);
  RangeScan scan;
  double taken_mb = heap_mb() - heap_before_mb;
  std::vector<RangeScan> whole;
  ScanConfig all = config.scan;
  all.lidar_range_m = all.depth_range_m = 100.0;
  const double radius_m = 3.0, period_s = to_seconds(sensor.period());
  std::vector<double> seen_since(world.obstacles.size(), -1.0), turned(world.obstacles.size(), -10.0);
  std::vector<Eigen::Vector3d> velocities(world.obstacles.size());
  std::vector<bool> usable(world.obstacles.size());
  for (double t_s = 0.0; t_s < options.duration_s; t_s += period_s) {
    const double angle = options.circle_mps / radius_m * t_s;
    const auto [sin, cos] = sin_cos(angle);
    const Pose pose{{radius_m * cos, radius_m * sin, 1.0},
                    attitude_of({0, 0, 0}, std::remainder(angle + std::numbers::pi / 2, 2 * std::numbers::pi))};
    const Utime utime = Utime(1000s) + to_duration(t_s);
    sogm_swarm::header_t header{};
    header.utime = to_us(utime);
    std::vector<sogm_swarm::lidar_scan_t> parts;
    sogm_swarm::depth_image_t image;
    if (options.sensor == "lidar") {
      parts = sensor.scan(caster, {}, t_s, pose, pose);
      parts[0].header = header;
    } else {
      image = sensor.images(caster, {}, t_s, pose, pose).at(0);
      image.header = header;
    }
    const auto read = [&](const ScanConfig& how, RangeScan* out) {
      if (options.sensor == "lidar") return read_scan(parts, how, config.resolution_m, out);
      read_scan(image, how, config.resolution_m, out);
    };
    const double taken_before_mb = heap_mb(), begun = processor_ms();
    read(config.scan, &scan);
    perception.update(scan, {}, header);
    const double ended = processor_ms();
    taken_mb += heap_mb() - taken_before_mb;
    sample->scan_ms.push_back(ended - begun);
    if (options.octomap > 0 && sample->scans % options.octomap == 0) {
      read(all, &whole.emplace_back());
    }
    ++sample->scans;
    digest(perception, sample);

    const auto is_of_column = [&](const Eigen::Vector3d& place) {
      return std::ranges::any_of(world.obstacles, [&](const WorldObstacle& obstacle) {
        return distance(obstacle.shape, place - state_at(obstacle, world, t_s)->position) < 0.08;
      });
    };
    const auto both = std::ranges::count_if(perception.moving_points(), is_of_column);
    sample->marked += std::ssize(perception.moving_points());
    sample->of_columns += std::ranges::count_if(scan.surfaces, is_of_column);
    sample->both += both;

    const auto predicted = [utime](const Track& track) {
      return Eigen::Vector3d(track.obstacle.position +
                             to_seconds(utime - track.obstacle.utime) * track.obstacle.velocity);
    };
    for (std::size_t i = 0; i < world.obstacles.size(); ++i) {
      const auto state = state_at(world.obstacles[i], world, t_s);
      if (state->velocity != velocities[i]) turned[i] = t_s;
      velocities[i] = state->velocity;
      const auto hits = std::ranges::count_if(scan.surfaces, [&](const Eigen::Vector3d& place) {
        return distance(world.obstacles[i].shape, place - state->position) < 0.08 &&
               (place - pose.position).norm() <= scan.range_m;
      });
      const double away_m = distance(world.obstacles[i].shape, pose.position - state->position);
      const bool is_alone = std::ranges::none_of(world.obstacles, [&](const WorldObstacle& other) {
        const Eigen::Vector3d apart = state_at(other, world, t_s)->position - state->position;
        return &other != &world.obstacles[i] && apart.norm() < options.diameter_m;
      });
      if (hits < 10 || away_m < 0.3 || !is_alone) {  // columns that are in one another are one to all who see them
        seen_since[i] = -1.0;
        continue;
      }
      if (seen_since[i] < 0.0) seen_since[i] = t_s, usable[i] = false;
      const Track* nearest = nullptr;
      double nearest_m = 0.5;
      for (const Track& track : perception.tracker().tracks()) {
        if (!perception.is_told(track)) continue;
        const double apart_m = (predicted(track) - state->position).head<2>().norm();
        if (apart_m < nearest_m) nearest_m = apart_m, nearest = &track;
      }
      const double seen_s = t_s - seen_since[i];
      if (seen_s > 0.4 && away_m < 5.0) {
        ++sample->due;
        if (nearest == nullptr) ++sample->missed;
      }
      if (nearest == nullptr) continue;
      const double wrong_mps = (nearest->obstacle.velocity - state->velocity).norm();
      if (!usable[i] && wrong_mps < 0.3) usable[i] = true, sample->latency_s.push_back(seen_s);
      if (away_m > 5.0) continue;
      sample->position_m.push_back(nearest_m);
      if (seen_s > 0.5 && t_s - turned[i] > 0.5) sample->velocity_mps.push_back(wrong_mps);
    }
    for (const Track& track : perception.tracker().tracks()) {
      if (!perception.is_moving(track) || (predicted(track) - pose.position).head<2>().norm() > 5.0) continue;
      const bool is_real = std::ranges::any_of(world.obstacles, [&](const WorldObstacle& obstacle) {
        return (state_at(obstacle, world, t_s)->position - predicted(track)).head<2>().norm() < 0.6;
      });
      if (is_real) continue;
      ++sample->false_moving;
      if (track.last_utime != utime) ++sample->false_unseen;
    }
  }
  sample->perception_mb = std::max(sample->perception_mb, taken_mb);
  octomap::OcTree tree(config.resolution_m);  // when all is over: it leaves nothing of what others have cached
  for (const RangeScan& seen : whole) sample->octomap_ms.push_back(octomap_ms(seen, 5.0, &tree));
}

int run(int argc, char** argv) {
  Options options;
  OptionSet set("perception_bench",
                "Tracks columns that move, from a simulated sensor on a robot that flies a circle.");
  set.add_positional("sensor", &options.sensor, "lidar or depth");
  set.add("obstacles", &options.obstacles, 0, 1000, "", "columns");
  set.add("worlds", &options.worlds, 1, 1000, "", "how many");
  set.add("duration", &options.duration_s, 1, 1000, "s", "of each flight");
  set.add("pose-noise-m", &options.noise_m, 0, 1, "m", "error of the sensor's position");
  set.add("pose-noise-deg", &options.noise_deg, 0, 10, "deg", "and of its direction");
  set.add("pose-m", &options.pose_m, 0, 1, "m", "what perception takes the one to be");
  set.add("pose-rad", &options.pose_rad, 0, 1, "rad", "and the other");
  set.add("acceleration", &options.acceleration_mps2, 0, 10, "m/s^2", "of tracks");
  set.add("octomap", &options.octomap, 0, 1000, "", "every so many scans an OctoMap gets the same points; 0: none");
  set.add("explores", &options.explores, "perception_daemon's: what was not seen to move stands");
  set.add("speed", &options.speed_mps, 0, 10, "m/s", "of the columns");
  set.add("circle", &options.circle_mps, 0, 10, "m/s", "of the robot");
  set.add("diameter", &options.diameter_m, 0.05, 2, "m", "of the columns");
  if (set.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  Sample sample;
  for (int i = 0; i < options.worlds; ++i) fly(options, i, &sample);
  double squares = 0.0;
  for (const double error : sample.position_m) squares += error * error;
  const auto three = [](double value) { return fixed(value, 3); };
  const auto two = [&](double TimingStats::*high, const std::vector<double>& values, const char* name) {
    const TimingStats stats = timing_stats(values);
    return "p50 " + three(stats.p50_ms) + ", " + name + " " + three(stats.*high);
  };
  const double positions = std::max(1.0, static_cast<double>(sample.position_m.size()));
  std::cout << "position rms " << three(std::sqrt(squares / positions)) << " m; velocity "
            << two(&TimingStats::p95_ms, sample.velocity_mps, "p95") << " m/s; latency "
            << two(&TimingStats::p95_ms, sample.latency_s, "p95") << " s\nmissed "
            << three(100.0 * sample.missed / std::max(sample.due, 1)) << " %; false moving tracks a scan "
            << three(double(sample.false_moving) / sample.scans) << " (out of sight "
            << three(double(sample.false_unseen) / sample.scans) << "); scan "
            << two(&TimingStats::p99_ms, sample.scan_ms, "p99") << " ms\nmoving points, intersection over union "
            << three(double(sample.both) / std::max<double>(1, sample.marked + sample.of_columns - sample.both))
            << "; OctoMap " << two(&TimingStats::p99_ms, sample.octomap_ms, "p99") << " ms; perception "
            << fixed(sample.perception_mb, 1) << " MB\ndigest " << std::hex << sample.digest << '\n';
  return 0;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) {
  try {
    return swarm::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "perception_bench: " << error.what() << '\n';
    return 2;
  }
}
