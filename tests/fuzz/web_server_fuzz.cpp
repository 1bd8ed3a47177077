// What a browser, or whoever else, may send to the view's web server: any bytes over a real connection, in pieces. The
// server answers or hangs up, in HTTP, and is there for the next one.
#include <boost/asio/ip/tcp.hpp>
#include <memory>
#include <string>

#include "tests/fuzz/fuzz_input.h"
#include "tools/viewer/web_server.h"

namespace swarm::fuzz {
namespace {

using boost::asio::ip::tcp;

class Watcher : public WebClient {
 public:
  void on_message(std::string_view text) override {
    expect(text.size() <= WebServer::kMaxMessage, "a message is no longer than allowed");
    last_.assign(text);
  }
  void next_frame(Bytes* bytes) override { bytes->assign(last_.begin(), last_.end()); }

 private:
  std::string last_ = "frame";
};

// One for all inputs, as it is for all browsers.
struct Served {
  boost::asio::io_context io;
  WebServer server{io, "127.0.0.1", 0, {{"/", {"page", "text/html"}}, {"/view.js", {"script", "text/javascript"}}}, [] {
                     return std::make_unique<Watcher>();
                   }};
};

constexpr std::string_view kKey = "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n";

std::string request(FuzzInput& input, int port) {
  const std::string here = "127.0.0.1:" + std::to_string(port);
  switch (input.byte() % 8) {
    case 0:
    case 1:
      return input.text();
    case 2:
      return "GET " + input.text() + " HTTP/1.1\r\nHost: " + here + "\r\n\r\n";
    case 3:
      return "GET / HTTP/1.1\r\nHost: " + input.text() + "\r\n\r\n";
    case 4:
      return "POST / HTTP/1.1\r\nHost: " + here + "\r\nContent-Length: " + input.text() + "\r\n\r\n" + input.text();
    default:
      return "GET /stream HTTP/1.1\r\nHost: " + here + "\r\nOrigin: http://" + (input.flag() ? here : input.text()) +
             "\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n" + std::string(kKey) + "\r\n";
  }
}

}  // namespace

void try_input(FuzzInput input) {
  static Served served;
  served.io.restart();
  boost::asio::io_context io;
  tcp::socket socket(io);
  socket.connect({boost::asio::ip::make_address_v4("127.0.0.1"), static_cast<unsigned short>(served.server.port())});
  socket.set_option(boost::asio::socket_base::linger(true, 0));  // no port is kept waiting
  socket.non_blocking(true);
  std::string answer;
  bool ended = false;
  const auto read = [&] {
    served.io.poll();
    char bytes[4096];
    boost::system::error_code error;
    while (!error) answer.append(bytes, socket.read_some(boost::asio::buffer(bytes), error));
    ended = error != boost::asio::error::would_block;
  };
  while (!input.empty() && !ended) {
    const std::string text = request(input, served.server.port());
    boost::system::error_code error;
    std::size_t sent = 0;
    while (sent < text.size() && !error) sent += socket.write_some(boost::asio::buffer(text.substr(sent)), error);
    read();
  }
  expect(answer.empty() || answer.starts_with("HTTP/1."), "it answers in HTTP");
  socket.close();
  served.io.poll();
}

}  // namespace swarm::fuzz
