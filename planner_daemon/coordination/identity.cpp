#include "planner_daemon/coordination/identity.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <limits>

namespace swarm {
namespace {

constexpr Duration kTwin = 2s;
constexpr Duration kHeardLate = 1s;  // an announcement, at most
constexpr Duration kStartsAnew = 1s;

}  // namespace

void Identity::advance(Utime now) {
  twin_until_ = std::min(twin_until_, now + kTwin);
  silent_until_ = std::min(silent_until_, now + kTwin);
  given_up_ = std::min(given_up_, now + kStartsAnew);
  if (!began_) began_ = now;
}

void Identity::set_clock(Utime now, Duration step) {
  began_ = now;
  twin_until_ += step;
  silent_until_ += step;
  given_up_ += step;
}

void Identity::said(BusId bus, const sogm_swarm::header_t& header) {
  auto& said = said_[static_cast<std::size_t>(bus)];
  said[static_cast<std::size_t>(header.seq) % said.size()] = header.utime;
}

bool Identity::is_of_twin(Utime now, BusId bus, const sogm_swarm::header_t& header) {
  const auto& said = said_[static_cast<std::size_t>(bus)];
  const bool was_said_here =
      header.boot == boot_ && header.utime == said[static_cast<std::size_t>(header.seq) % said.size()];
  const bool is_own = was_said_here || !began_ || to_utime(header.utime) <= std::max(*began_, now - kHeardLate);
  if (!is_own) beware_of_twin(now, header.boot);
  return !is_own;
}

void Identity::give_way(Utime now, std::int32_t its_boot) {
  if (boot_ > its_boot) silent_until_ = now + kTwin;
}

bool Identity::outdo(Utime now, std::int32_t its_boot, bool has_flown) {
  if (its_boot <= boot_) return false;
  if (has_flown || num_outdone_ == num_peers_ || its_boot == std::numeric_limits<std::int32_t>::max()) {
    beware_of_twin(now, its_boot);
    return false;
  }
  ++num_outdone_;
  spdlog::warn("peers know a later start of robot {}: this is not start {}, but {}", robot_id_, boot_, its_boot + 1);
  boot_ = its_boot + 1;
  began_ = now;  // what was said before is not another one's
  return true;
}

bool Identity::start_anew(Utime now) {
  if (now < given_up_ || boot_ == std::numeric_limits<std::int32_t>::max()) return false;
  given_up_ = now + kStartsAnew;
  ++boot_;
  began_ = now;  // what was said before is not another one's
  spdlog::warn("peers have given robot {} up, as they did not hear it: this is start {} now", robot_id_, boot_);
  return true;
}

void Identity::beware_of_twin(Utime now, std::int32_t its_boot) {
  if (!has_twin(now)) {
    spdlog::error(
        "another broadcaster speaks as robot {}: nothing is committed until 2 s after the last of it (boot {} here, {} "
        "there)",
        robot_id_, boot_, its_boot);
  }
  twin_until_ = now + kTwin;
}

}  // namespace swarm
