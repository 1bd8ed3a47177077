#include "swarm_sim/results/air_traffic.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/lcm_wire.h"
#include "lcmtypes/bus/seal.h"
#include "swarm_sim/results/report.h"

namespace swarm {
namespace {

constexpr std::size_t kUdpHeader = 8, kIpHeader = 20, kLlcHeader = 8;
constexpr std::size_t kMacHeader = 24 + 4;  // of a data frame to a group, with the checksum behind it
constexpr std::size_t kServiceBits = 16, kTailBits = 6;
constexpr Duration kPreamble = 20us, kSymbol = 4us;

constexpr int kKeepers = -1;  // among the robots' ids

template <class T>
std::optional<int> sender(std::span<const std::uint8_t> bytes) {
  T message;
  return decode(bytes, &message) == Refusal::kNone ? std::optional<int>(message.header.robot_id) : std::nullopt;
}
// Of an announcement or a roster; nothing: it is neither.
std::optional<int> sender(std::string_view channel, std::span<const std::uint8_t> bytes) {
  if (is_carried_by<sogm_swarm::cell_announcement_t>(channel)) return sender<sogm_swarm::cell_announcement_t>(bytes);
  if (!is_carried_by<sogm_swarm::cell_roster_t>(channel)) return sender<sogm_swarm::packed_announcement_t>(bytes);
  return sender<sogm_swarm::cell_roster_t>(bytes) ? std::optional(kKeepers) : std::nullopt;
}

double per(double amount, double of) {
  return of > 0.0 ? amount / of : 0.0;
}

}  // namespace

std::size_t datagram_bytes(std::string_view channel, std::size_t message_bytes) {
  return kUdpHeader + kLcmShortHead + channel.size() + 1 + message_bytes + kSealBytes;
}

Duration frame_duration(std::size_t datagram_bytes, double rate_mbps) {
  const std::size_t bytes = kMacHeader + kLlcHeader + kIpHeader + datagram_bytes;
  const double symbol_bits = rate_mbps * static_cast<double>(kSymbol.count());
  const double symbols = std::ceil(static_cast<double>(kServiceBits + 8 * bytes + kTailBits) / symbol_bits);
  return kPreamble + static_cast<std::int64_t>(symbols) * kSymbol;
}

double frame_airtime_us(std::size_t datagram_bytes, double rate_mbps) {
  const double mean_backoff_us = 0.5 * kMostBackoffSlots * static_cast<double>(kSlotTime.count());
  return mean_backoff_us + static_cast<double>((kDifs + frame_duration(datagram_bytes, rate_mbps)).count());
}

void AirTraffic::send(double t_s, std::string_view channel, std::span<const std::uint8_t> bytes) {
  const std::optional<int> from = t_s < 0.0 ? std::nullopt : sender(channel, bytes);
  if (!from) return;
  const std::size_t size = datagram_bytes(channel, bytes.size());
  Count& robot = robots_[*from];
  ++robot.sent;
  robot.sent_bytes += static_cast<std::int64_t>(size);
  const auto second = static_cast<std::size_t>(t_s);
  if (seconds_.size() <= second) seconds_.resize(second + 1);
  for (std::size_t i = 0; i < kAirRates_mbps.size(); ++i)
    seconds_[second][i] += frame_airtime_us(size, kAirRates_mbps[i]);
}

void AirTraffic::receive(int robot_id, std::size_t datagrams) {
  robots_[robot_id].received += static_cast<std::int64_t>(datagrams);
  counts_received_ = true;
}

void AirTraffic::finish(RunReport* report) const {
  AirReport& air = report->air;
  double sum_bytes = 0.0;
  for (RobotReport& robot : report->robots) {
    const auto found = robots_.find(robot.verdict.id);
    const Count count = found == robots_.end() ? Count() : found->second;
    const auto sent = static_cast<double>(count.sent), bytes = static_cast<double>(count.sent_bytes);
    robot.sent_hz = per(sent, report->duration_s);
    robot.received_hz = counts_received_ ? per(static_cast<double>(count.received), report->duration_s) : NAN;
    robot.datagram_bytes = per(bytes, sent);
    air.datagrams += count.sent;
    sum_bytes += bytes;
  }
  if (const auto keepers = robots_.find(kKeepers); keepers != robots_.end()) {
    air.datagrams += keepers->second.sent;
    sum_bytes += static_cast<double>(keepers->second.sent_bytes);
  }
  air.datagram_bytes = per(sum_bytes, static_cast<double>(air.datagrams));
  for (std::size_t i = 0; i < kAirRates_mbps.size(); ++i) {
    double sum_us = 0.0, busiest_us = 0.0;
    for (const auto& second_us : seconds_) {
      sum_us += second_us[i];
      busiest_us = std::max(busiest_us, second_us[i]);
    }
    air.airtime[i] = {per(1e-6 * sum_us, report->duration_s), 1e-6 * busiest_us};
  }
}

}  // namespace swarm
