// How far a peer's clock is from ours, from what its announcements and ours took by both clocks.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <optional>

namespace swarm {

// A message takes (delay + offset) one way and (delay - offset) the other. The least delay of many is nearly the same
// both ways; how nearly, nobody can know: kDoubt of it is allowed for.
class ClockOffset {
 public:
  static constexpr int kEnough = 50;                     // messages
  static constexpr std::int64_t kWindow_us = 5'000'000;  // what counts came within this, or one more
  static constexpr double kDoubt = 0.25;

  // A message of the peer came, up to some minutes old; utimes by our clock and by its.
  void heard(std::int64_t now_us, std::int64_t sent_utime) {
    if (now_us >= begun_us_ + kWindow_us) {
      before_ = now_us >= begun_us_ + 2 * kWindow_us ? Window() : newest_;
      newest_ = Window();
      begun_us_ = now_us;
    }
    newest_.least_us = std::min(newest_.least_us, now_us - sent_utime);
    ++newest_.count;
  }
  // The peer says what its least_delay_us() of our messages is.
  void told(std::int32_t delay_us) { told_us_ = delay_us; }

  // Of the peer's messages [us], by both clocks: may be negative. None: few came lately.
  std::optional<std::int32_t> least_delay_us() const {
    if (newest_.count + before_.count < kEnough) return {};
    return static_cast<std::int32_t>(std::min(newest_.least_us, before_.least_us));
  }
  // By how much our clock is ahead of the peer's [us].
  std::optional<std::int64_t> offset_us() const {
    const auto here = least_delay_us();
    if (!here || !told_us_) return {};
    return (std::int64_t{*here} - *told_us_) / 2;
  }
  bool beyond(std::int64_t limit_us) const {
    const auto offset = offset_us();
    if (!offset) return false;
    const double delay_us = 0.5 * (static_cast<double>(*least_delay_us()) + *told_us_);
    return static_cast<double>(std::abs(*offset) - limit_us) > kDoubt * std::max(delay_us, 0.0);
  }

 private:
  struct Window {
    std::int64_t least_us = std::numeric_limits<std::int64_t>::max();
    int count = 0;
  };
  Window newest_, before_;
  std::int64_t begun_us_ = 0;
  std::optional<std::int32_t> told_us_;
};

}  // namespace swarm
