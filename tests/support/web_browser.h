// What the tests of the view share: a browser's part of HTTP and WebSocket, and a real one, steered over its DevTools.
#pragma once

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "tests/support/harness.h"
#include "tests/support/view_frame.h"

namespace swarm::test {

struct WebAnswer {
  int status = 0;
  std::string body;
};

// One request to 127.0.0.1.
inline WebAnswer web_request(int port, const std::string& target, const std::string& host = "localhost",
                             boost::beast::http::verb verb = boost::beast::http::verb::get) {
  namespace http = boost::beast::http;
  boost::asio::io_context io;
  boost::asio::ip::tcp::socket socket(io);
  socket.connect({boost::asio::ip::make_address("127.0.0.1"), static_cast<unsigned short>(port)});
  http::request<http::empty_body> request(verb, target, 11);
  request.set(http::field::host, host);
  request.set(http::field::connection, "close");
  http::write(socket, request);
  boost::beast::flat_buffer buffer;
  http::response_parser<http::string_body> parser;
  parser.body_limit(1u << 24);
  http::read(socket, buffer, parser);
  return {static_cast<int>(parser.get().result_int()), parser.get().body()};
}

// A WebSocket to 127.0.0.1. Everything throws boost::system::system_error when it fails.
class WebSocket {
 public:
  WebSocket(int port, const std::string& target, const std::string& origin = "", const std::string& host = "localhost")
      : socket_(io_) {
    auto& tcp = boost::beast::get_lowest_layer(socket_);
    tcp.open(boost::asio::ip::tcp::v4());
    tcp.set_option(boost::asio::socket_base::receive_buffer_size(1 << 16));
    tcp.connect({boost::asio::ip::make_address("127.0.0.1"), static_cast<unsigned short>(port)});
    socket_.set_option(
        boost::beast::websocket::stream_base::decorator([&](boost::beast::websocket::request_type& request) {
          if (!origin.empty()) request.set(boost::beast::http::field::origin, origin);
        }));
    socket_.read_message_max(1u << 28);
    socket_.handshake(host, target);
    socket_.text(true);
  }

  void send(const std::string& text) { socket_.write(boost::asio::buffer(text)); }
  std::string receive() {
    boost::beast::flat_buffer buffer;
    socket_.read(buffer);
    return boost::beast::buffers_to_string(buffer.data());
  }
  // Without a word.
  void drop() { boost::beast::get_lowest_layer(socket_).close(); }

 private:
  boost::asio::io_context io_;
  boost::beast::websocket::stream<boost::asio::ip::tcp::socket> socket_;
};

// A page's end of the stream.
class Watcher {
 public:
  explicit Watcher(int port)
      : socket_(port, "/stream", "http://localhost:" + std::to_string(port), "localhost:" + std::to_string(port)) {}
  void tell(const std::string& command) { socket_.send(command); }
  ViewFrame next() { return ViewFrame(socket_.receive()); }
  // The first frame, of 200, that is as wanted.
  std::optional<ViewFrame> until(const std::function<bool(const ViewFrame&)>& wanted) {
    for (int i = 0; i < 200; ++i)
      if (ViewFrame frame = next(); wanted(frame)) return frame;
    return std::nullopt;
  }
  void drop() { socket_.drop(); }

 private:
  WebSocket socket_;
};

// Chromium without a screen.
class Browser {
 public:
  static constexpr const char* kPath = "/usr/bin/chromium";
  static bool is_installed() { return std::filesystem::exists(kPath); }

  explicit Browser(const std::string& url)
      : program_({kPath, "--headless", "--no-sandbox", "--disable-quic", "--no-first-run",
                  "--disable-background-networking", "--disable-component-update", "--disable-sync",
                  "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=1400,850",
                  "--remote-debugging-port=0", "--user-data-dir=" + (profile_ / "profile"), url}) {
    const std::string file = profile_ / "profile/DevToolsActivePort";
    const bool up = wait_for(60.0, [&] {
      std::ifstream in(file);
      return static_cast<bool>(in >> port_);
    });
    if (!up) throw std::runtime_error("Chromium does not start: " + program_.err());
    wait_for(20.0, [&] {
      for (const WebJson& tab : WebJson::parse(web_request(port_, "/json").body))
        if (tab.value("type", "") == "page" && tab.value("url", "") == url) tab_ = tab["webSocketDebuggerUrl"];
      return !tab_.empty();
    });
    if (tab_.empty()) throw std::runtime_error("Chromium has not opened " + url);
    tools_ = std::make_unique<WebSocket>(port_, tab_.substr(tab_.find("/devtools")));
  }

  // The value of an expression on the page; null while it cannot be had.
  WebJson evaluate(const std::string& expression) {
    const WebJson answer = call("Runtime.evaluate", {{"expression", expression}, {"returnByValue", true}});
    return answer.contains("result") ? answer["result"].value("value", WebJson()) : WebJson();
  }
  // Until it is true.
  bool wait_until(double seconds, const std::string& expression) {
    return wait_for(seconds, [&] { return evaluate(expression) == true; });
  }
  // By the mouse, so often one after the other; by the keyboard.
  void click(double x, double y, int times = 1) {
    for (int count = 1; count <= times; ++count)
      for (const char* type : {"mousePressed", "mouseReleased"}) mouse(type, x, y, count);
  }
  // On the middle of the element that is named so, in CSS.
  void click_on(const std::string& selector) {
    const WebJson box = evaluate("document.querySelector('" + selector + "').getBoundingClientRect().toJSON()");
    if (!box.is_object()) throw std::runtime_error("the page has no " + selector);
    click(box["x"].get<double>() + 0.5 * box["width"].get<double>(),
          box["y"].get<double>() + 0.5 * box["height"].get<double>());
  }
  void drag(double x, double y, double to_x, double to_y) {
    mouse("mousePressed", x, y, 1);
    mouse("mouseMoved", to_x, to_y, 0);
    mouse("mouseReleased", to_x, to_y, 1);
  }
  void press(const std::string& key) {
    for (const char* type : {"keyDown", "keyUp"}) (void)call("Input.dispatchKeyEvent", {{"type", type}, {"key", key}});
  }
  // A PNG file, base64.
  std::string screenshot() { return call("Page.captureScreenshot", {{"format", "png"}}).value("data", ""); }

 private:
  void mouse(const char* type, double x, double y, int clicks) {
    (void)call("Input.dispatchMouseEvent",
               {{"type", type}, {"x", x}, {"y", y}, {"button", "left"}, {"buttons", 1}, {"clickCount", clicks}});
  }
  WebJson call(const std::string& method, const WebJson& parameters) {
    tools_->send(WebJson{{"id", ++calls_}, {"method", method}, {"params", parameters}}.dump());
    for (;;) {
      const WebJson answer = WebJson::parse(tools_->receive());
      if (answer.value("id", 0) == calls_) return answer.value("result", WebJson::object());
    }
  }

  struct Profile {  // Chromium writes to it until it has ended
    std::string path = TemporaryDirectory().path();
    ~Profile() { std::filesystem::remove_all(path, ignored); }
    std::string operator/(const std::string& name) const { return path + "/" + name; }
    std::error_code ignored;
  };

  Profile profile_;
  Program program_;
  int port_ = 0, calls_ = 0;
  std::string tab_;
  std::unique_ptr<WebSocket> tools_;
};

}  // namespace swarm::test
