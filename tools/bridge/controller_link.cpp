#include "tools/bridge/controller_link.h"

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/udp.hpp>
#include <boost/asio/serial_port.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <charconv>
#include <chrono>
#include <deque>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/time.h"

namespace swarm {
namespace {

using boost::asio::ip::udp;
using boost::system::error_code;
using std::chrono::steady_clock;

constexpr std::size_t kMaxDatagram = 65536;
constexpr std::size_t kMaxQueue = 8;  // frames that wait for the serial device: 80 ms of setpoints
constexpr Duration kReopen = 1s;
constexpr Duration kPeerSilence = 3s;  // then another may take its place

[[noreturn]] void fail(const LinkAddress& address, const std::string& what, const error_code& error) {
  throw std::runtime_error(address.text + ": " + what + ": " + error.message());
}

// Datagrams.
class UdpLink : public ControllerLink {
 public:
  UdpLink(boost::asio::io_context& io, const LinkAddress& address, mavlink::Sender controller,
          mavlink::Parser::Taker take)
      : ControllerLink(controller, std::move(take)), socket_(io), datagram_(kMaxDatagram) {
    error_code error;
    socket_.open(udp::v4(), error);
    if (error) fail(address, "no socket", error);
    if (address.kind == LinkAddress::Kind::kUdpListen) {
      const udp::endpoint here(boost::asio::ip::address_v4::loopback(),
                               static_cast<std::uint16_t>(address.port_or_baud));
      socket_.bind(here, error);
      if (error) fail(address, "cannot listen on " + name_of(here), error);
    } else {
      udp::resolver resolver(io);
      const auto found =
          resolver.resolve(udp::v4(), address.host_or_device, std::to_string(address.port_or_baud), error);
      if (error || found.empty()) fail(address, "no such host '" + address.host_or_device + "'", error);
      socket_.connect(*found.begin(), error);  // takes datagrams from there only
      if (error) fail(address, "cannot send to " + name_of(*found.begin()), error);
      fixed_ = true;
      report_.connected = true;
      report_.peer = name_of(*found.begin());
    }
    socket_.non_blocking(true, error);
    if (error) fail(address, "no socket", error);
    await();
  }

  void send(std::span<const std::uint8_t> frame) override {
    if (!report_.connected) return;
    error_code error;
    const auto buffer = boost::asio::buffer(frame.data(), frame.size());
    // Where nobody listens at the moment, that is told once by an error; the next one is sent.
    if (fixed_)
      socket_.send(buffer, 0, error);
    else
      socket_.send_to(buffer, peer_, 0, error);
    ++(error ? report_.dropped : report_.frames_out);
  }

 private:
  static std::string name_of(const udp::endpoint& endpoint) {
    return endpoint.address().to_string() + ":" + std::to_string(endpoint.port());
  }

  void await() {
    socket_.async_receive_from(boost::asio::buffer(datagram_), sender_, [this](const error_code& error, std::size_t n) {
      if (error == boost::asio::error::operation_aborted) return;
      if (!error) on_datagram(n);
      await();
    });
  }

  void on_datagram(std::size_t size) {
    const auto now = steady_clock::now();
    const bool by_peer = fixed_ || (report_.connected && sender_ == peer_);
    if (!by_peer && report_.connected && now - heard_ < kPeerSilence) {
      ++report_.strangers;
      return;
    }
    // The first that sends a frame of the controller is the controller.
    sending_ = sender_;
    if (!receive(std::span(datagram_).first(size))) return;
    heard_ = now;
    if (by_peer) return;
    peer_ = sending_;
    report_.connected = true;
    report_.peer = name_of(peer_);
  }

  udp::socket socket_;
  std::vector<std::uint8_t> datagram_;
  udp::endpoint sender_, sending_, peer_;
  bool fixed_ = false;
  steady_clock::time_point heard_;
};

// A serial device, which may be unplugged and come back.
class SerialLink : public ControllerLink {
 public:
  SerialLink(boost::asio::io_context& io, const LinkAddress& address, mavlink::Sender controller,
             mavlink::Parser::Taker take)
      : ControllerLink(controller, std::move(take)), address_(address), port_(io), timer_(io) {
    std::string what;
    if (const error_code error = open(&what)) fail(address, what, error);
  }

  void send(std::span<const std::uint8_t> frame) override {
    if (!port_.is_open()) {
      ++report_.dropped;
      return;
    }
    queue_.emplace_back(frame.begin(), frame.end());
    if (queue_.size() > kMaxQueue) {
      queue_.pop_front();
      ++report_.dropped;
    }
    if (!writing_) write();
  }

 private:
  error_code open(std::string* what) {
    using Port = boost::asio::serial_port;
    error_code error;
    *what = "cannot be opened";
    port_.open(address_.host_or_device, error);
    if (error) return error;
    const auto set = [&](const auto& option, const std::string& name) {
      if (error) return;
      *what = name;
      port_.set_option(option, error);
    };
    set(Port::character_size(8), "is no serial device");
    set(Port::parity(Port::parity::none), "is no serial device");
    set(Port::stop_bits(Port::stop_bits::one), "is no serial device");
    set(Port::flow_control(Port::flow_control::none), "is no serial device");
    set(Port::baud_rate(static_cast<unsigned>(address_.port_or_baud)),
        "baud rate " + std::to_string(address_.port_or_baud));
    if (error) {
      error_code ignored;
      port_.close(ignored);
      return error;
    }
    ++opened_;
    queue_.clear();
    writing_ = false;
    report_.connected = true;
    report_.peer = address_.host_or_device;
    read();
    return {};
  }

  // Ends what was begun before the device was opened last.
  bool is_over(int opened, const error_code& error) const {
    return opened != opened_ || error == boost::asio::error::operation_aborted;
  }

  void read() {
    port_.async_read_some(boost::asio::buffer(bytes_),
                          [this, opened = opened_](const error_code& error, std::size_t n) {
                            if (is_over(opened, error)) return;
                            if (error) return lose();
                            receive(std::span(bytes_).first(n));
                            read();
                          });
  }

  void write() {
    writing_ = true;
    frame_ = std::move(queue_.front());
    queue_.pop_front();
    boost::asio::async_write(port_, boost::asio::buffer(frame_),
                             [this, opened = opened_](const error_code& error, std::size_t) {
                               if (is_over(opened, error)) return;
                               if (error) return lose();
                               ++report_.frames_out;
                               writing_ = false;
                               if (!queue_.empty()) write();
                             });
  }

  void lose() {
    if (!port_.is_open()) return;
    error_code ignored;
    port_.close(ignored);
    report_.connected = false;
    ++report_.lost;
    reopen_later();
  }

  void reopen_later() {
    timer_.expires_after(kReopen);
    timer_.async_wait([this](const error_code& error) {
      std::string what;
      if (!error && open(&what)) reopen_later();
    });
  }

  LinkAddress address_;
  boost::asio::serial_port port_;
  boost::asio::steady_timer timer_;
  std::array<std::uint8_t, 1024> bytes_;
  std::vector<std::uint8_t> frame_;  // which is being written
  std::deque<std::vector<std::uint8_t>> queue_;
  bool writing_ = false;
  int opened_ = 0;  // how often
};

// The number in [1, high] that the text after the last colon is.
std::optional<int> number_after_colon(const std::string& text, std::size_t colon, int high) {
  int value = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data() + colon + 1, end, value);
  const bool good = error == std::errc() && stop == end && value >= 1 && value <= high;
  return good ? std::optional(value) : std::nullopt;
}

}  // namespace

LinkAddress LinkAddress::parse(const std::string& text) {
  constexpr int kMaxPort = 65535, kMaxBaud = 100'000'000;
  const auto refuse = [&](const std::string& rule) { throw OptionError("'" + text + "': " + rule); };
  const std::size_t first = text.find(':'), last = text.rfind(':');
  const bool serial = text.starts_with("serial:"), is_udp = text.starts_with("udp:");
  if ((!serial && !is_udp) || (serial && first == last))
    refuse("must be udp:PORT, udp:HOST:PORT or serial:DEVICE:BAUD");
  LinkAddress address;
  address.text = text;
  if (first != last) {
    address.host_or_device = text.substr(first + 1, last - first - 1);
    if (address.host_or_device.empty()) refuse(serial ? "there is no device in it" : "there is no host in it");
  }
  const auto number = number_after_colon(text, last, serial ? kMaxBaud : kMaxPort);
  if (!number)
    refuse(serial ? "the baud rate must be a whole number" : "the port must be a whole number within [1, 65535]");
  address.port_or_baud = *number;
  address.kind = serial ? Kind::kSerial : first == last ? Kind::kUdpListen : Kind::kUdpSend;
  return address;
}

std::unique_ptr<ControllerLink> ControllerLink::open(boost::asio::io_context& io, const LinkAddress& address,
                                                     mavlink::Sender controller, mavlink::Parser::Taker take) {
  if (address.kind == LinkAddress::Kind::kSerial)
    return std::make_unique<SerialLink>(io, address, controller, std::move(take));
  return std::make_unique<UdpLink>(io, address, controller, std::move(take));
}

// A frame of protocol version 1 is one, too: who hears version 2 will speak it.
bool ControllerLink::receive(std::span<const std::uint8_t> bytes) {
  const auto heard = [this] { return parser_.frames() + parser_.skipped(mavlink::Skipped::kMavlink1); };
  const std::int64_t before = heard();
  parser_.feed(bytes, take_);
  return heard() > before;
}

}  // namespace swarm
