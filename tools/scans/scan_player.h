// Plays recorded scans onto a robot's onboard bus as if they were measured now, with where the sensor was.
#pragma once

#include <optional>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/recurring.h"
#include "tools/scans/pose_file.h"
#include "tools/scans/scan_list.h"

namespace swarm {

struct ScanPlayerConfig {
  int robot_id = 0;
  int sensor = 0;      // which of the robot's
  double speed = 1.0;  // so many times as fast as recorded
  bool state = true;   // also says that the robot is where the sensor is, 50 times a second
};

class ScanPlayer : public Node {
 public:
  // `boot`: grows at every start. Throws std::runtime_error where a scan was taken before the first pose or after the
  // last one.
  ScanPlayer(const ScanPlayerConfig& config, std::vector<RecordedScan> scans, PoseTrack poses, std::int32_t boot);

  std::vector<Subscription> subscriptions() const override { return {}; }
  void on_message(Utime, BusId, std::string_view, std::span<const std::uint8_t>, Outbox&) override {}
  // Throws what read_point_cloud() throws.
  Utime step(Utime now, Outbox& outbox) override;

  bool is_over() const { return played_ == scans_.size(); }
  std::size_t played() const { return played_; }
  std::int64_t points() const { return points_; }    // that were played
  std::int64_t thinned() const { return thinned_; }  // scans with more points than fit a message
  std::size_t late() const { return late_; }         // scans that came more than 0.1 s later than they should have

 private:
  double played_at(Utime utime) const;  // time of the recording [s]
  Utime due(double t_s) const;
  void play(Utime utime, double t_s, Outbox& outbox);
  void publish_state(Utime now, Outbox& outbox);

  ScanPlayerConfig config_;
  std::vector<RecordedScan> scans_;
  PoseTrack poses_;
  HeaderSource scan_headers_, state_headers_;
  std::optional<Utime> began_;
  std::vector<Eigen::Vector3d> next_;  // points of scans_[played_], read ahead
  std::size_t played_ = 0, late_ = 0;
  std::int64_t points_ = 0, thinned_ = 0;
  Recurring state_;
};

}  // namespace swarm
