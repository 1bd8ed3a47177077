// Who is heard on the swarm bus, whether they speak our version of the wire, and what their clocks and the network make
// of the time; for tools/check_machine.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <boost/asio/steady_timer.hpp>
#include <cstdio>
#include <iostream>
#include <map>
#include <string>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "lcmtypes/bus/realtime_host.h"

namespace swarm {
namespace {

constexpr std::size_t kRobotAt = 14;  // of every message

struct Heard {
  std::map<Refusal, int> messages;  // kNone: understood
  Duration least_delay = Duration::max();
};

class Listener : public Node {
 public:
  std::vector<Subscription> subscriptions() const override { return {{BusId::kSwarm, channel::kAnnouncement}}; }
  void on_message(Utime now, BusId, std::string_view, std::span<const std::uint8_t> bytes, Outbox&) override {
    if (bytes.size() < kRobotAt + 2) return;
    Heard& heard = robots[bytes[kRobotAt] << 8 | bytes[kRobotAt + 1]];
    sogm_swarm::announcement_t message;
    const Refusal refusal = decode_packed(bytes, &message);
    ++heard.messages[refusal];
    if (refusal == Refusal::kNone)
      heard.least_delay = std::min(heard.least_delay, now - to_utime(message.header.utime));
  }
  Utime step(Utime now, Outbox&) override { return now + 1s; }

  std::map<int, Heard> robots;
};

int hear(int argc, const char* const* argv) {
  std::string url = kDefaultSwarmUrl;
  double seconds = 3.0;
  OptionSet options(
      "swarm_hear",
      "Listens to the swarm bus and prints a line for each robot: ROBOT ok MESSAGES LEAST_DELAY_MS, or\n"
      "ROBOT unreadable REASON COUNT. The delay is what the message takes and what the clocks differ by.");
  options.add("swarm-url", &url, "bus between the robots");
  options.add("seconds", &seconds, 0.1, 600, "s", "how long to listen");
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  spdlog::set_level(spdlog::level::off);  // the lines are all there is to say
  RealtimeHost host;
  Listener listener;
  host.add("swarm_hear", listener, "", url);
  boost::asio::steady_timer timer(host.io(), to_duration(seconds));
  timer.async_wait([&host](const boost::system::error_code&) { host.stop(); });
  host.run();
  for (const auto& [robot, heard] : listener.robots) {
    for (const auto& [refusal, count] : heard.messages) {
      if (refusal == Refusal::kNone) {
        std::printf("%d ok %d %.1f\n", robot, count, to_ms(heard.least_delay));
      } else {
        std::printf("%d unreadable %s %d\n", robot, to_string(refusal), count);
      }
    }
  }
  return 0;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) try { return swarm::hear(argc, argv); } catch (const std::exception& error) {
  std::cerr << "swarm_hear: " << error.what() << std::endl;
  return 2;
}
