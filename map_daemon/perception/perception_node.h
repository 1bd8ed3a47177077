// The perception daemon's node: from scans of depth cameras and LiDARs to obstacles and to what was seen, which the map
// daemon draws.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/receive.h"
#include "lcmtypes/bus/recurring.h"
#include "map_daemon/perception/kept_map.h"
#include "map_daemon/perception/map_file.h"
#include "map_daemon/perception/peer_mask.h"
#include "map_daemon/perception/perception.h"
#include "map_daemon/sogm_codec.h"

namespace swarm {

struct PerceptionNodeConfig {
  int robot_id = 0;
  PerceptionConfig perception;
  double peer_margin_m = 0.15;  // around peers and the robot itself: what is so near to where they fly is them
  double peer_timeout_s = 0.5;  // who was not heard for so long is an obstacle
  double max_jump_m = 0.5;      // of a sensor's pose between scans, beyond what max_speed explains
  double max_speed_mps = 10.0;
  double clock_limit_s = 0.1;  // messages from further in the future are refused
  std::string map;             // OctoMap file (.bt) that is read at the start, kept, and written; empty: none
};

void declare(OptionSet& options, PerceptionNodeConfig& config);
void verify(const PerceptionNodeConfig& config);

class PerceptionNode : public Node {
 public:
  // `boot`: grows at every start. `stopwatch` null: durations are 0; they are published only with `publish_durations`.
  // Throws what MapFile throws.
  PerceptionNode(const PerceptionNodeConfig& config, std::int32_t boot, Stopwatch stopwatch = nullptr,
                 bool publish_durations = true);
  ~PerceptionNode() override;  // writes the map
  PerceptionNode(const PerceptionNode&) = delete;
  PerceptionNode& operator=(const PerceptionNode&) = delete;

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;
  bool on_clock_step(Utime now, Duration step) override;
  Activity activity(Utime now) const override;

  const RefusalCounts& refused() const { return refused_; }
  const Perception& perception() const { return perception_; }

 private:
  struct Sensor {
    SequenceGate images;
    ScanAssembler scans;
    RangeScan scan;
    bool is_new = false;
    bool has_pose = false;
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  // of its newest scan, W [m]
    Utime utime{};
  };

  Refusal on_image(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_scan(Utime now, std::span<const std::uint8_t> bytes);
  Refusal on_announcement(Utime now, bool own, std::span<const std::uint8_t> bytes);
  Refusal on_map_request(Utime now, std::span<const std::uint8_t> bytes);
  TimeWindow window(Utime now) const;
  // A whole scan was read: whether it can be used.
  Refusal take(Sensor* sensor);
  void process(Sensor* sensor, Outbox& outbox);
  void keep_map(Utime utime);
  std::int16_t map_state() const;       // perception_status_t::k...
  std::int16_t state(Utime now) const;  // perception_status_t::k...
  void publish_status(Utime now, Outbox& outbox);

  PerceptionNodeConfig config_;
  Stopwatch stopwatch_;
  bool publish_durations_;
  HeaderSource obstacle_headers_, space_headers_, status_headers_;
  RefusalCounts refused_;
  sogm_swarm::depth_image_t image_;  // the newest message of each, whose memory serves the next
  sogm_swarm::lidar_scan_t part_;
  std::array<Sensor, kMaxSensors> sensors_;
  PeerMask robots_;
  std::map<int, SequenceGate> announcement_gates_;  // by robot
  Perception perception_;
  SogmEncoder encoder_;
  std::optional<MapFile> map_file_;
  KeptMap kept_;
  bool is_map_asked_for_ = false;
  SequenceGate map_requests_;
  Recurring status_, map_exchange_;
  Utime last_scan_utime_{};
  bool jumped_ = false;  // the newest scan
  std::int32_t scans_ = 0, scans_at_last_status_ = 0, jumps_ = 0, blind_ = 0;
  double scan_ms_ = 0.0;
};

}  // namespace swarm
