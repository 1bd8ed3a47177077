// The way to the flight controller: UDP or a serial device, in the event loop of the host. Nothing blocks; what cannot
// be sent in time is dropped, oldest first: a setpoint that waits is of no use.
#pragma once

#include <boost/asio/io_context.hpp>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "tools/bridge/mavlink.h"

namespace swarm {

// Written as "udp:PORT" (waits on 127.0.0.1 for the controller, and answers it), "udp:HOST:PORT" (sends there first) or
// "serial:DEVICE:BAUD".
struct LinkAddress {
  enum class Kind : std::uint8_t { kUdpListen, kUdpSend, kSerial };
  // Throws OptionError with the text and the rule.
  static LinkAddress parse(const std::string& text);

  std::string text;
  Kind kind = Kind::kUdpListen;
  std::string host_or_device;  // empty when listening
  int port_or_baud = 0;
};

struct LinkReport {
  bool connected = false;  // the device is open; the controller's address is known
  std::string peer;        // who that is
  std::int64_t frames_out = 0, dropped = 0;
  std::int64_t strangers = 0;  // datagrams from others than the peer
  std::int64_t lost = 0;       // how often the device vanished
};

class ControllerLink {
 public:
  // Opens it; throws std::runtime_error with one line that names the link and what is wrong. `take` is called from
  // io.run() with each message of `controller`. Ends before `io` does.
  static std::unique_ptr<ControllerLink> open(boost::asio::io_context& io, const LinkAddress& address,
                                              mavlink::Sender controller, mavlink::Parser::Taker take);
  virtual ~ControllerLink() = default;
  ControllerLink(const ControllerLink&) = delete;
  ControllerLink& operator=(const ControllerLink&) = delete;

  // A whole frame; copied.
  virtual void send(std::span<const std::uint8_t> frame) = 0;

  const LinkReport& report() const { return report_; }
  const mavlink::Parser& parser() const { return parser_; }

 protected:
  ControllerLink(mavlink::Sender controller, mavlink::Parser::Taker take)
      : parser_(controller), take_(std::move(take)) {}
  // True when the bytes held a frame of the controller.
  bool receive(std::span<const std::uint8_t> bytes);

  LinkReport report_;

 private:
  mavlink::Parser parser_;
  mavlink::Parser::Taker take_;
};

}  // namespace swarm
