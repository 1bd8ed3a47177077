// mocap_input: see mocap_node.h.
#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/udp.hpp>
#include <boost/asio/steady_timer.hpp>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/realtime_host.h"
#include "tools/bridge/mocap_log.h"
#include "tools/bridge/mocap_node.h"

namespace swarm {
namespace {

using boost::asio::ip::udp;

// The datagrams and the log, in the host's event loop.
class MocapSocket {
 public:
  // Throws std::runtime_error with address and reason.
  MocapSocket(RealtimeHost& host, MocapNode& node, const boost::asio::ip::address_v4& address, int port)
      : host_(host), node_(node), socket_(host.io()), timer_(host.io()), datagram_(65536) {
    const udp::endpoint here(address, static_cast<std::uint16_t>(port));
    try {
      socket_.open(udp::v4());
      socket_.bind(here);
    } catch (const boost::system::system_error& error) {
      throw std::runtime_error("--address, --port: cannot listen on " + address.to_string() + ":" +
                               std::to_string(port) + ": " + error.code().message());
    }
    spdlog::info("listens on {}:{}", address.to_string(), port);
    await();
    tell_soon();
  }

 private:
  void await() {
    socket_.async_receive(boost::asio::buffer(datagram_),
                          [this](const boost::system::error_code& error, std::size_t n) {
                            if (error == boost::asio::error::operation_aborted) return;
                            if (!error) {
                              host_.deliver(node_, [&](Utime now, Outbox& outbox) {
                                node_.on_datagram(now, std::span(datagram_).first(n), outbox);
                              });
                            }
                            await();
                          });
  }

  void tell_soon() {
    timer_.expires_after(100ms);
    timer_.async_wait([this](const boost::system::error_code& error) {
      if (error) return;
      host_.deliver(node_, [this](Utime now, Outbox&) { write(log_.update(now, node_.report())); });
      tell_soon();
    });
  }

  RealtimeHost& host_;
  MocapNode& node_;
  udp::socket socket_;
  boost::asio::steady_timer timer_;
  std::vector<std::uint8_t> datagram_;
  MocapLog log_;
};

boost::asio::ip::address_v4 parse_address(const std::string& text) {
  boost::system::error_code error;
  const auto address = boost::asio::ip::make_address_v4(text, error);
  if (error) throw OptionError("must be an IPv4 address of this computer");
  return address;
}

int run(int argc, const char* const* argv) {
  MocapConfig config;
  std::string address = "127.0.0.1";
  int port = 7755;
  MocapNode* node = nullptr;
  return daemon_main(
      "mocap_input",
      "Publishes the robot's state and the obstacles around it from motion capture. Takes UDP datagrams of one JSON\n"
      "object, in metres, in the world frame of the maps:\n"
      "{\"t\": seconds or null, \"bodies\": [{\"name\": \"robot0\", \"position\": [x,y,z], \"quaternion\": "
      "[w,x,y,z]}]}",
      argc, argv, DaemonBuses::kOnboard,
      [&](OptionSet& options) {
        declare(options, config);
        options.add(
            "address", &address,
            "of this computer, where datagrams come in: of the interface that the motion capture is on; 0.0.0.0: any",
            [](const std::string& text) { (void)parse_address(text); });
        options.add("port", &port, 1, 65535, "", "where datagrams come in");
      },
      [&] {
        auto made = std::make_unique<MocapNode>(config, new_boot());
        node = made.get();
        return made;
      },
      [&](RealtimeHost& host) { return std::make_shared<MocapSocket>(host, *node, parse_address(address), port); });
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) {
  return swarm::run(argc, argv);
}
