#include "swarm_sim/results/bus_recorder.h"

#include "lcmtypes/bus/channels.h"

namespace swarm {

void BusRecorder::hear(Utime now, BusId bus, int robot_id, std::string_view channel,
                       std::span<const std::uint8_t> bytes) {
  if (log_ != nullptr) log_->write(bus, robot_id, now, channel, bytes);
  const std::string_view kind = kind_of(channel);
  auto count = channels_.find(kind);
  if (count == channels_.end()) count = channels_.try_emplace(std::string(kind)).first;
  ++count->second.messages;
  count->second.bytes += static_cast<std::int64_t>(bytes.size());
  if (bus == BusId::kOnboard && channel == channel::kOwnTrajectory) audit_.hear_own(bytes);
  const bool is_of_robot = kind == channel::kAnnouncement || kind == channel::kCellAnnouncement;
  if (bus != BusId::kSwarm || !(is_of_robot || kind == channel::kCellRoster)) return;
  if (is_of_robot) audit_.collect(bytes, clocks_are_set_ ? std::optional(now) : std::nullopt);
  air_.send(world_time_(now), channel, bytes);
}

void BusRecorder::finish(RunReport* report) {
  for (const auto& [name, count] : channels_) {
    report->channels[name].messages += count.messages;
    report->channels[name].bytes += count.bytes;
  }
  audit_.finish();
  report->count_commits(audit_);
  air_.finish(report);
}

}  // namespace swarm
