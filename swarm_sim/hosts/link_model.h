// The radio between robots in simulation: what becomes of a datagram on its way.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "lcmtypes/bus/time.h"
#include "swarm_sim/world/outage.h"
#include "swarm_sim/world/random.h"

namespace swarm {

// Of each datagram and receiver alike, independent of all others.
struct LinkOptions {
  double delay_ms = 0.0;
  double jitter_ms = 0.0;       // the delay is uniform within +- this, at least 0
  double loss = 0.0;            // share that never arrives
  double duplicate = 0.0;       // share that arrives twice, each copy with a delay of its own
  double reorder = 0.0;         // share that is held back for up to kHeldBack_ms more, so that later ones overtake it
  std::vector<Outage> outages;  // robots that neither send nor receive
  double rate_mbps = 0.0;       // of the channel that all share, see radio_channel.h; 0: nobody waits for it

  static constexpr double kHeldBack_ms = 200.0;
  bool perfect() const;
};

class LinkModel {
 public:
  // The same seed and calls give the same answers.
  LinkModel(const LinkOptions& options, std::uint64_t seed);

  // Delays after which the copies of a datagram arrive that one robot sends to another at world time `t_s`; none:
  // it is lost. Valid until the next call.
  std::span<const Duration> deliveries(int from_id, int to_id, double t_s);

 private:
  LinkOptions options_;
  Random random_;
  std::vector<Duration> delays_;
};

}  // namespace swarm
