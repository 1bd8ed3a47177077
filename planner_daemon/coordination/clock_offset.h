// How far a peer's clock is from ours, from what its announcements and ours took by both clocks.
#pragma once

#include <algorithm>
#include <optional>

#include "lcmtypes/bus/time.h"

namespace swarm {

// A message takes (delay + offset) one way and (delay - offset) the other. The least delay of many is nearly the same
// both ways; how nearly, nobody can know: kDoubt of it is allowed for.
class ClockOffset {
 public:
  static constexpr int kEnough = 25;       // messages
  static constexpr Duration kWindow = 5s;  // what counts came within this, or one more
  static constexpr double kDoubt = 0.25;

  // A message of the peer came; by our clock, and by its when it was sent.
  void heard(Utime now, Utime sent) {
    if (now >= begun_ + kWindow) {
      before_ = now >= begun_ + 2 * kWindow ? Window() : newest_;
      newest_ = Window();
      begun_ = now;
    }
    newest_.least = std::min(newest_.least, now - sent);
    ++newest_.count;
  }
  // The peer says what its least_delay() of our messages is.
  void told(Duration delay) { told_ = delay; }

  // Of the peer's messages, by both clocks: may be negative. None: few came lately.
  std::optional<Duration> least_delay() const {
    if (newest_.count + before_.count < kEnough) return {};
    return std::min(newest_.least, before_.least);
  }
  // By how much our clock is ahead of the peer's.
  std::optional<Duration> offset() const {
    const auto here = least_delay();
    if (!here || !told_) return {};
    return (*here - *told_) / 2;
  }
  bool beyond(Duration limit) const {
    const auto ahead = offset();
    if (!ahead) return false;
    const Duration round_trip = std::max(*least_delay() + *told_, 0us);
    return to_seconds(std::chrono::abs(*ahead) - limit) > kDoubt * 0.5 * to_seconds(round_trip);
  }

 private:
  struct Window {
    Duration least = Duration::max();
    int count = 0;
  };
  Window newest_, before_;
  Utime begun_{};
  std::optional<Duration> told_;
};

}  // namespace swarm
