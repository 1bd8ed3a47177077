// What crosses the air between robots: how many datagrams of how many bytes, and what share of the time they take a
// channel of 802.11 that all robots share.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/time.h"

namespace swarm {

struct RunReport;

// The channel access of 802.11a/g: OFDM in 20 MHz (IEEE 802.11-2016, 17.4.4; a DIFS is a SIFS of 16 us and two slots).
// Multicast frames are neither acknowledged nor sent again, so their contention window never widens.
inline constexpr Duration kSlotTime = 9us, kDifs = 34us;
inline constexpr int kMostBackoffSlots = 15;  // CWmin: as many slots of backoff at most, on average half of it

// Bytes of the UDP datagram, with its header, that carries a sealed message of so many bytes.
std::size_t datagram_bytes(std::string_view channel, std::size_t message_bytes);

// How long the frame of a UDP datagram of so many bytes, with its header, is on the air: preamble and signal field,
// then MAC, LLC and IP headers, datagram and checksum in symbols of 4 us (TXTIME of IEEE 802.11-2016, 17.4.3).
// `rate_mbps`: of OFDM, 6 to 54 Mbit/s.
Duration frame_duration(std::size_t datagram_bytes, double rate_mbps);

// How long it takes the channel [us]: with a DIFS and the mean backoff before it.
double frame_airtime_us(std::size_t datagram_bytes, double rate_mbps);

// Of how many [Mbit/s] reports tell the airtime: 802.11's lowest rate, which multicast goes at unless the network sets
// another, and one that does.
inline constexpr std::array<double, 2> kAirRates_mbps = {6, 24};

// What became of datagrams in a modelled channel, see radio_channel.h.
struct RadioCounts {
  std::int64_t sent = 0;      // handed in
  std::int64_t collided = 0;  // of them: lost in a collision
  std::int64_t dropped = 0;   // of them: did not fit into the queue

  double collided_share() const { return sent > 0 ? static_cast<double>(collided) / static_cast<double>(sent) : 0.0; }
  double dropped_share() const { return sent > 0 ? static_cast<double>(dropped) / static_cast<double>(sent) : 0.0; }
};

// Counts the datagrams of a flight.
class AirTraffic {
 public:
  // A message that a robot, or a keeper, sent to all others at world time `t_s`; before the flight (below 0) and what
  // is neither announcement nor roster does not count.
  void send(double t_s, std::string_view channel, std::span<const std::uint8_t> bytes);
  // So many datagrams arrive at a robot. Without any such call reports do not tell what robots received.
  void receive(int robot_id, std::size_t datagrams);

  // Adds the figures to the report, which has its duration and robots.
  void finish(RunReport* report) const;

 private:
  struct Count {
    std::int64_t sent = 0, sent_bytes = 0, received = 0;
  };
  std::map<int, Count> robots_;  // by id
  std::vector<std::array<double, kAirRates_mbps.size()>>
      seconds_;  // airtime in each second of the flight [us], by rate
  bool counts_received_ = false;
};

}  // namespace swarm
