// The radio between robots in simulation: what becomes of a datagram on its way.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "lcmtypes/bus/time.h"
#include "swarm_sim/world/random.h"

namespace swarm {

// A robot neither sends nor receives in [from_s, to_s) of world time.
struct LinkOutage {
  int robot_id = 0;
  double from_s = 0.0, to_s = 0.0;
};

// Of each datagram and receiver alike, independent of all others.
struct LinkOptions {
  double delay_ms = 0.0;
  double jitter_ms = 0.0;  // the delay is uniform within +- this, at least 0
  double loss = 0.0;       // share that never arrives
  double duplicate = 0.0;  // share that arrives twice, each copy with a delay of its own
  double reorder = 0.0;    // share that is held back for up to kHeldBack_ms more, so that later ones overtake it
  std::vector<LinkOutage> outages;

  static constexpr double kHeldBack_ms = 200.0;
  bool perfect() const;
};

// "ROBOT:FROM_S:TO_S,..."; empty: none. Throws OptionError with the part that is wrong.
std::vector<LinkOutage> parse_outages(const std::string& text);

class LinkModel {
 public:
  // The same seed and calls give the same answers.
  LinkModel(const LinkOptions& options, std::uint64_t seed);

  // Delays after which the copies of a datagram arrive that one robot sends to another at world time `t_s`; none:
  // it is lost. Valid until the next call.
  std::span<const Duration> deliveries(int from_id, int to_id, double t_s);

 private:
  bool out(int robot_id, double t_s) const;

  LinkOptions options_;
  Random random_;
  std::vector<Duration> delays_;
};

}  // namespace swarm
