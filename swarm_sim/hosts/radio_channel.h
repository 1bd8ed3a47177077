// One channel of 802.11 that all robots share: who has something to send waits until it is free, and frames that begin
// at once are lost for everybody, as nobody sends a multicast frame again.
//
// The distributed coordination function (IEEE 802.11-2016, 10.3.4) with the times of air_traffic.h. Of real radios it
// leaves out: robots that do not hear each other, frames that are received though another one collides with them, other
// networks, and a backoff after the last datagram that a robot has.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <vector>

#include "lcmtypes/bus/time.h"
#include "swarm_sim/results/air_traffic.h"
#include "swarm_sim/world/random.h"

namespace swarm {

class RadioChannel {
 public:
  // Datagrams that wait in a robot's radio; of more the oldest one is dropped, as Linux does (fq_codel). It is
  // the one that says least: each announcement says all.
  static constexpr std::size_t kMostQueued = 16;
  // A datagram needs up to so long, uniformly, from its program to the radio. Robots that answer the same message do
  // not do so in the same microsecond.
  static constexpr Duration kMostHandOver = 500us;

  // `rate_mbps` as of frame_duration(). The same seed and calls give the same answers.
  RadioChannel(double rate_mbps, std::uint64_t seed) : rate_mbps_(rate_mbps), random_(seed) {}

  // A robot hands in a datagram of so many bytes, with its UDP header. advance() calls `deliver` when everybody has
  // heard it, unless it is lost. `now` does not go back, as below.
  void send(Utime now, int robot_id, std::size_t datagram_bytes, std::function<void()> deliver);
  // When something happens next; kNever: nothing.
  Utime due() const;
  // Does what is due.
  void advance(Utime now);

  const RadioCounts& counts() const { return counts_; }

 private:
  struct Frame {
    Duration duration{};
    std::function<void()> deliver;
  };
  struct Station {
    std::deque<Frame> queue;     // the first one contends for the channel, or is on the air
    Utime begins{};              // when the first one does, if the channel stays free; on the air: when it did
    Utime newest_handed_over{};  // datagrams do not overtake each other
  };
  struct HandOver {
    int robot_id = 0;
    Frame frame;
  };

  bool is_busy() const { return !on_air_.empty(); }
  // When everybody hears that the next frame has begun: who begins by then does not, and collides with it.
  Utime sensed() const;
  void take(Utime now, HandOver handed_over);
  void begin_frames(Utime sensed);
  void end_frames();
  Duration backoff();

  double rate_mbps_;
  Random random_;
  RadioCounts counts_;
  std::multimap<Utime, HandOver> handed_over_;  // when they reach the radio
  std::map<int, Station> stations_;             // by robot
  std::vector<Station*> on_air_;
  Utime ends_{};  // what is on the air, or was last
};

}  // namespace swarm
