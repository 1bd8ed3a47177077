// The perception daemon's node: whatever scans come, statuses go out, reports decode and are of the scans that were
// taken.
#include <set>

#include "map_daemon/perception/perception_node.h"
#include "tests/fuzz/fuzz_node.h"

namespace swarm::fuzz {
namespace {

class Bench : public NodeBench<Bench, PerceptionNode> {
 public:
  static PerceptionNodeConfig config() {
    PerceptionNodeConfig config;
    config.robot_id = kRobot;
    return config;
  }
  Bench() : NodeBench(config(), 1) { step(); }

  using NodeBench::hear;
  void hear(const sogm_swarm::perception_status_t&) { last_status_ = elapsed; }
  void hear(const sogm_swarm::obstacles_t& report) {
    std::set<int> ids;
    for (const sogm_swarm::obstacle_t& obstacle : report.obstacles) {
      expect(ids.insert(obstacle.id).second, "a report has each track once");
      expect(obstacle.size[0] < 2.5, "columns are no thicker than what they are taken in pieces of");
    }
  }
  void on_step_of_clock(Duration) { last_status_ = elapsed; }

  template <class Message>
  void set_pose(FuzzInput& input, Message* message) {
    message->header = header(input, kRobot);
    message->sensor = input.integer<std::int16_t>(0, kMaxSensors - 1);
    Eigen::Map<Eigen::Vector3d>(message->position) = place(input, input.byte() % 32 == 0 ? kMaxPosition_m : 0.3);
    const int axis = input.byte() % 4;
    message->orientation[axis] = 0.6, message->orientation[(axis + 1) % 4] = 0.8;
  }
  void send_scan(FuzzInput& input) {
    sogm_swarm::lidar_scan_t scan{};
    set_pose(input, &scan);
    scan.num_parts = input.integer<std::int16_t>(1, input.byte() % 8 == 0 ? 16 : 2);
    scan.part = input.integer<std::int16_t>(0, static_cast<std::int16_t>(scan.num_parts - 1));
    const auto around = static_cast<std::int16_t>(input.byte() % 4 == 0 ? 32767 : 1200);
    for (int count = 3 * input.byte(); count > 0; --count)
      scan.coordinates.push_back(input.integer<std::int16_t>(static_cast<std::int16_t>(-around), around));
    scan.num_coordinates = static_cast<std::int32_t>(scan.coordinates.size());
    send(BusId::kOnboard, channel::kLidarScan, scan);
  }
  void send_image(FuzzInput& input) {
    sogm_swarm::depth_image_t image{};
    set_pose(input, &image);
    const bool odd = input.byte() % 8 == 0;
    image.focal_px[0] = static_cast<float>(odd ? input.real(1, 1e5) : 10.0);
    image.focal_px[1] = static_cast<float>(odd ? input.real(1, 1e5) : 10.0);
    image.center_px[0] = image.center_px[1] = static_cast<float>(odd ? input.real(-1e5, 1e5) : 5.0);
    image.width = static_cast<std::int16_t>(1 + input.byte() % 20);
    image.num_pixels = image.width * (1 + input.byte() % 20);
    const auto deepest = static_cast<std::int16_t>(input.byte() % 4 == 0 ? 32767 : 5000);
    for (int i = 0; i < image.num_pixels; ++i) image.depth_mm.push_back(input.integer<std::int16_t>(0, deepest));
    send(BusId::kOnboard, channel::kDepthImage, image);
  }
  void check() { expect(elapsed - last_status_ <= 1s, "statuses go out"); }

 private:
  Duration last_status_{};
};

}  // namespace

void try_input(FuzzInput input) {
  Bench bench;
  play(input, 12, 10s, &bench, [&](int number) {
    if (number == 0) {
      bench.deliver_anything(input);
    } else if (number <= 4) {
      bench.send_scan(input);
    } else if (number <= 8) {
      bench.send_image(input);
    }
    return number <= 8;
  });
}

}  // namespace swarm::fuzz
