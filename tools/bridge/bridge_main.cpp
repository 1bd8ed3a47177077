// mavlink_bridge: see bridge_node.h.
#include <boost/asio/steady_timer.hpp>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/realtime_host.h"
#include "tools/bridge/bridge_log.h"
#include "tools/bridge/bridge_node.h"
#include "tools/bridge/controller_link.h"

namespace swarm {
namespace {

// The link to the controller and the log, in the host's event loop.
class BridgeEnds {
 public:
  BridgeEnds(RealtimeHost& host, BridgeNode& node, const BridgeConfig& config, const std::string& link)
      : host_(host),
        node_(node),
        timer_(host.io()),
        link_(ControllerLink::open(
            host.io(), LinkAddress::parse(link), controller_of(config), [this](const mavlink::Message& message) {
              host_.deliver(node_, [&](Utime now, Outbox& outbox) { node_.on_frame(now, message, outbox); });
            })) {
    tell_soon();
  }

  void send(std::span<const std::uint8_t> frame) { link_->send(frame); }

 private:
  void tell_soon() {
    timer_.expires_after(100ms);
    timer_.async_wait([this](const boost::system::error_code& error) {
      if (error) return;
      host_.deliver(node_, [this](Utime now, Outbox&) {
        write(log_.update(now, node_.report(), link_->report(), link_->parser()));
      });
      tell_soon();
    });
  }

  RealtimeHost& host_;
  BridgeNode& node_;
  boost::asio::steady_timer timer_;
  BridgeLog log_;
  std::unique_ptr<ControllerLink> link_;
};

int run(int argc, const char* const* argv) {
  BridgeConfig config;
  std::string link = "udp:14540";
  BridgeNode* node = nullptr;
  std::weak_ptr<BridgeEnds> ends;
  return daemon_main(
      "mavlink_bridge",
      "Leads a flight controller that speaks MAVLink 2 (PX4: offboard mode, ArduPilot: guided mode) along the\n"
      "setpoints of the broadcast daemon, along the committed trajectory while there are none, and publishes the\n"
      "robot's state.",
      argc, argv, DaemonBuses::kOnboard,
      [&](OptionSet& options) {
        declare(options, config);
        options.add("link", &link,
                    "to the flight controller: udp:PORT (waits for it on 127.0.0.1), udp:HOST:PORT or "
                    "serial:DEVICE:BAUD",
                    [](const std::string& text) { (void)LinkAddress::parse(text); });
      },
      [&] {
        auto made = std::make_unique<BridgeNode>(config, new_boot(), [&ends](std::span<const std::uint8_t> frame) {
          if (const auto open = ends.lock()) open->send(frame);
        });
        node = made.get();
        return made;
      },
      [&](RealtimeHost& host) {
        auto made = std::make_shared<BridgeEnds>(host, *node, config, link);
        ends = made;
        return made;
      });
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) {
  return swarm::run(argc, argv);
}
