// The map daemon's node: whatever comes, maps keep their rate while the robot's state is known, statuses go out, and
// what was said to be somewhere is in the next map.
#include <cmath>
#include <optional>

#include "lcmtypes/bus/limits.h"
#include "map_daemon/map_node.h"
#include "tests/fuzz/fuzz_node.h"

namespace swarm::fuzz {
namespace {

using sogm_swarm::obstacle_t;

class Bench : public NodeBench<Bench, MapNode> {
 public:
  static MapConfig config(bool is_coarse) {
    MapConfig config;
    config.robot_id = kRobot;
    config.least_window_m = {4, 4, 3};
    config.resolution_m = is_coarse ? 0.5 : 0.2;
    config.horizon_s = is_coarse ? 2.0 : 0.5;
    config.v_max_mps = 1.0;
    config.margin_m = is_coarse ? 0.0 : 0.05;
    config.growth_mps = is_coarse ? 0.0 : 0.1;
    return config;
  }
  explicit Bench(bool is_coarse) : NodeBench(config(is_coarse), 1) { step(); }

  using NodeBench::hear;
  void hear(const sogm_swarm::map_status_t&) { last_status_ = elapsed; }
  void hear(const sogm_swarm::sogm_t& part) {
    const Assembly assembly = assembler_.add(part, &map_);
    expect(assembly.status != AssemblyStatus::kRefused, "maps can be put together");
    if (assembly.status != AssemblyStatus::kComplete) return;
    last_map_ = elapsed;
    expect(map_.start_utime <= now + 100ms && map_.start_utime >= now - 1s, "a map is of its time");
    if (obstacles_ && now - to_utime(obstacles_->header.utime) < 900ms) {
      for (const obstacle_t& obstacle : obstacles_->obstacles) look_for(obstacle);
    }
  }
  void on_step_of_clock(Duration) { forget(); }

  void send_state(FuzzInput& input) {
    sogm_swarm::robot_state_t state{};
    state.header = header(input, kRobot);
    Eigen::Map<Eigen::Vector3d>(state.position) = place(input, input.byte() % 16 == 0 ? kMaxPosition_m : 3.0);
    Eigen::Map<Eigen::Vector3d>(state.velocity) = place(input, input.byte() % 16 == 0 ? kMaxVelocity_mps : 1.0);
    if (!is_taken([&] { send(BusId::kOnboard, channel::kRobotState, state); })) return;
    if (now > known_until_ || elapsed < known_since_) known_since_ = elapsed;
    known_until_ = to_utime(state.header.utime) + 500ms;
  }
  void send_obstacles(FuzzInput& input) {
    sogm_swarm::obstacles_t message{};
    message.header = header(input, kRobot);
    for (int count = input.byte() % 6; count > 0; --count) message.obstacles.push_back(obstacle(input));
    message.num_obstacles = static_cast<std::int32_t>(message.obstacles.size());
    // What it looks for is what the node will have when it steps.
    const auto before = std::exchange(obstacles_, message);
    if (!is_taken([&] { send(BusId::kOnboard, channel::kObstacles, message); })) obstacles_ = before;
  }
  void send_voxels(FuzzInput& input) {
    sogm_swarm::obstacle_voxels_t message{};
    message.header = header(input, kRobot);
    message.id = input.byte();
    Eigen::Map<Eigen::Vector3d>(message.position) = place(input, 3.0);
    Eigen::Map<Eigen::Vector3d>(message.velocity) = place(input, input.byte() % 16 == 0 ? kMaxVelocity_mps : 1.0);
    message.age_s = input.byte() % 8 == 0 ? input.real(0, 60) : 0.0;
    message.resolution = input.real(0.01, 1.0);
    for (int count = input.byte() % 64; count > 0; --count) {
      const bool far = input.byte() % 32 == 0;
      const auto index = [&] { return input.integer<std::int16_t>(far ? -32768 : -10, far ? 32767 : 10); };
      auto& voxel = message.voxels.emplace_back();
      voxel.resize(3);
      for (std::int16_t& axis : voxel) axis = index();
    }
    message.num_voxels = static_cast<std::int32_t>(message.voxels.size());
    send(BusId::kOnboard, channel::kObstacleVoxels, message);
  }
  // After anything at all nothing is known of what the node holds.
  void forget() {
    known_until_ = {};
    known_since_ = elapsed;
    obstacles_.reset();
    last_status_ = elapsed;
  }
  void check() {
    expect(elapsed - last_status_ <= 1s, "statuses go out");
    if (now <= known_until_ && now >= known_until_ - 600ms)
      expect(elapsed - std::max(last_map_, known_since_) <= 101ms, "maps keep their rate");
  }

 private:
  template <class Sending>
  bool is_taken(Sending&& sending) {
    const std::int32_t refused = node.refused().total();
    sending();
    return node.refused().total() == refused;
  }
  static obstacle_t obstacle(FuzzInput& input) {
    obstacle_t o{};
    o.id = input.byte();
    o.shape = input.integer<std::int16_t>(obstacle_t::kColumn, obstacle_t::kSphere);
    const std::uint8_t what = input.byte();
    Eigen::Map<Eigen::Vector3d>(o.position) = place(input, what % 16 == 0 ? kMaxPosition_m : 3.0);
    Eigen::Map<Eigen::Vector3d>(o.velocity) = place(input, what % 16 == 1 ? kMaxVelocity_mps : what & 64 ? 1.0 : 0.0);
    o.yaw = input.real(-3.14, 3.14);
    const int sizes = o.shape == obstacle_t::kBox ? 3 : o.shape == obstacle_t::kSphere ? 1 : 2;
    for (int i = 0; i < sizes; ++i) o.size[i] = input.real(0.0, what % 16 == 2 ? kMaxObstacleSize_m : 2.0);
    o.age_s = what % 16 == 3 ? input.real(0, 60) : 0.0;
    return o;
  }
  // The voxel that holds its middle is occupied, however thin it is.
  void look_for(const obstacle_t& obstacle) {
    if (obstacle.shape == obstacle_t::kRing) return;  // there is nothing in its middle
    const double since_s = to_seconds(map_.start_utime - to_utime(obstacles_->header.utime)) + obstacle.age_s;
    const Eigen::Vector3d middle = Eigen::Vector3d(obstacle.position) + since_s * Eigen::Vector3d(obstacle.velocity);
    if (middle.cwiseAbs().maxCoeff() > 1e3) return;
    const Eigen::Array3d in_voxels = middle.array() / map_.geometry.resolution_m;
    if (((in_voxels - in_voxels.round()).abs() < 1e-3).any()) return;  // it may be in either
    const Eigen::Vector3i voxel = map_.geometry.voxel_of(middle);
    if (map_.geometry.contains(voxel)) expect(map_.occupied(0, voxel), "an obstacle's middle is occupied");
  }

  SogmAssembler assembler_;
  Sogm map_;
  std::optional<sogm_swarm::obstacles_t> obstacles_;  // newest that was taken
  Utime known_until_{};                               // the robot's state
  Duration known_since_{}, last_map_{}, last_status_{};
};

}  // namespace

void try_input(FuzzInput input) {
  Bench bench(input.flag());
  play(input, 12, 10s, &bench, [&](int number) {
    if (number == 0) {
      bench.forget();
      bench.deliver_anything(input);
      bench.forget();
    } else if (number <= 4) {
      bench.send_state(input);
    } else if (number <= 7) {
      bench.send_obstacles(input);
    } else if (number == 8) {
      bench.send_voxels(input);
    }
    return number <= 8;
  });
}

}  // namespace swarm::fuzz
