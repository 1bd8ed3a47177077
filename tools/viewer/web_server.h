// A small web server: a few files, and a stream of binary frames to every browser over WebSocket (Boost.Beast), in the
// thread of its io_context. Whoever reads slowly gets fewer frames, always the newest; nothing is kept for him.
#pragma once

#include <boost/asio/io_context.hpp>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/time.h"

namespace swarm {

// One browser's end of the stream.
class WebClient {
 public:
  virtual ~WebClient() = default;
  virtual void on_message(std::string_view text) = 0;  // from the browser, at most kMaxMessage bytes; never throws
  virtual void next_frame(std::vector<std::uint8_t>* bytes) = 0;
};

struct WebFile {
  std::string content;
  std::string type;  // as "text/html; charset=utf-8"
};

class WebServer {
 public:
  static constexpr std::size_t kMaxMessage = 4096;  // bytes, of a browser
  static constexpr int kMaxConnections = 64;        // beyond them they are closed at once
  static constexpr Duration kFrame = 33ms;          // between two frames

  using Files = std::map<std::string, WebFile>;  // by path, "/" first of all
  using MakeClient = std::function<std::unique_ptr<WebClient>()>;

  // Port 0: any that is free. Throws std::runtime_error, one line, when address and port cannot be had. The stream is
  // at /stream, and only for pages of this server's own that were opened by an IP address or as localhost: other web
  // sites in the same browser must not fly the swarm.
  WebServer(boost::asio::io_context& io, const std::string& address, int port, Files files, MakeClient make_client);
  ~WebServer();

  int port() const;

 private:
  class Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace swarm
