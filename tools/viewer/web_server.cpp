#include "tools/viewer/web_server.h"

#include <algorithm>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <list>
#include <optional>
#include <stdexcept>

namespace swarm {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using beast::error_code;
using Request = http::request<http::string_body>;
using Response = http::response<http::span_body<const char>>;  // of what lives as long as the server

constexpr Duration kPatience = 20s;   // with a silent browser
constexpr int kSendBuffer = 1 << 17;  // bytes, of the kernel: what waits there is late
constexpr std::uint64_t kMaxBody = 1024;

// Whether "name:port" names this server as only its own user would: other names can be made to point here by anybody.
bool is_plain_host(std::string_view host) {
  const bool is_v6 = host.starts_with('[');
  const std::size_t end = is_v6 ? host.find(']') : std::min(host.find(':'), host.size());
  if (end == host.npos) return false;
  const std::string name(is_v6 ? host.substr(1, end - 1) : host.substr(0, end));
  const std::string_view port = host.substr(is_v6 ? end + 1 : end);
  const bool is_port = port.size() >= 2 && port.size() <= 6 && port.front() == ':' &&
                       port.find_first_not_of("0123456789", 1) == port.npos;
  if (!port.empty() && !is_port) return false;
  error_code error;
  if (is_v6) {
    asio::ip::make_address_v6(name, error);
  } else {
    asio::ip::make_address_v4(name, error);
  }
  return !error || (name == "localhost" && !is_v6);
}

std::string_view view_of(beast::string_view text) {
  return {text.data(), text.size()};
}

beast::span<const char> span_of(std::string_view text) {
  return {text.data(), text.size()};
}

}  // namespace

class WebServer::Impl : public std::enable_shared_from_this<WebServer::Impl> {
 public:
  Impl(asio::io_context& io, Files files, MakeClient make_client)
      : files_(std::move(files)), make_client_(std::move(make_client)), acceptor_(io), timer_(io) {}

  void open(const std::string& address, int port) {
    const std::string where = address + ", port " + std::to_string(port) + ": ";
    error_code error;
    const auto ip = asio::ip::make_address(address, error);
    if (error) throw std::runtime_error(where + "must be an IP address of this computer");
    const tcp::endpoint endpoint(ip, static_cast<unsigned short>(port));
    acceptor_.open(endpoint.protocol());
    acceptor_.set_option(tcp::acceptor::reuse_address(true));
    acceptor_.bind(endpoint, error);
    if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
    if (error == asio::error::address_in_use)
      throw std::runtime_error(where + "is in use by another program; choose another with --port");
    if (error) throw std::runtime_error(where + error.message());
  }

  void start() {
    accept();
    tick();
  }
  void stop();
  int port() const { return acceptor_.local_endpoint().port(); }

 private:
  class Connection;
  class Stream;

  void accept();
  void tick();
  Response answer(const Request& request) const;

  Files files_;
  MakeClient make_client_;
  tcp::acceptor acceptor_;
  asio::steady_timer timer_;
  std::list<std::weak_ptr<Stream>> streams_;
  int num_connections_ = 0;
};

// A browser that asks for files.
class WebServer::Impl::Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(std::shared_ptr<Impl> server, tcp::socket socket) : server_(std::move(server)), tcp_(std::move(socket)) {
    ++server_->num_connections_;
  }
  ~Connection() { --server_->num_connections_; }

  void read();

 private:
  void on_request();

  std::shared_ptr<Impl> server_;
  beast::tcp_stream tcp_;
  beast::flat_buffer buffer_{8192};
  std::optional<http::request_parser<http::string_body>> parser_;
  Response response_;
};

// A browser that watches.
class WebServer::Impl::Stream : public std::enable_shared_from_this<Stream> {
 public:
  Stream(std::shared_ptr<Impl> server, beast::tcp_stream&& tcp)
      : server_(std::move(server)), client_(server_->make_client_()), socket_(std::move(tcp)) {
    ++server_->num_connections_;
  }
  ~Stream() { --server_->num_connections_; }

  void open(const Request& request) {
    beast::get_lowest_layer(socket_).expires_never();
    error_code ignored;
    tcp::socket& raw = beast::get_lowest_layer(socket_).socket();
    raw.set_option(tcp::no_delay(true), ignored);
    raw.set_option(asio::socket_base::send_buffer_size(kSendBuffer), ignored);
    websocket::stream_base::timeout timeout{};
    timeout.handshake_timeout = timeout.idle_timeout = kPatience;
    timeout.keep_alive_pings = true;
    socket_.set_option(timeout);
    socket_.read_message_max(kMaxMessage);
    socket_.auto_fragment(false);
    socket_.binary(true);
    socket_.async_accept(request, [self = shared_from_this()](const error_code& error) {
      if (error) return;
      self->open_ = true;
      self->read();
    });
  }

  // The newest frame, unless the one before is still on its way.
  void tick() {
    if (!open_ || writing_) return;
    client_->next_frame(&frame_);
    writing_ = true;
    socket_.async_write(asio::buffer(frame_), [self = shared_from_this()](const error_code& error, std::size_t) {
      self->writing_ = false;
      if (error) self->open_ = false;
    });
  }

  void close() {
    open_ = false;
    error_code ignored;
    beast::get_lowest_layer(socket_).socket().close(ignored);
  }

 private:
  void read() {
    socket_.async_read(buffer_, [self = shared_from_this()](const error_code& error, std::size_t) {
      if (error) return self->close();
      const auto data = self->buffer_.cdata();
      self->client_->on_message({static_cast<const char*>(data.data()), data.size()});
      self->buffer_.clear();
      self->read();
    });
  }

  std::shared_ptr<Impl> server_;
  std::unique_ptr<WebClient> client_;
  websocket::stream<beast::tcp_stream> socket_;
  beast::flat_buffer buffer_;
  std::vector<std::uint8_t> frame_;
  bool open_ = false, writing_ = false;
};

void WebServer::Impl::Connection::read() {
  parser_.emplace();
  parser_->body_limit(kMaxBody);
  tcp_.expires_after(kPatience);
  http::async_read(tcp_, buffer_, *parser_, [self = shared_from_this()](const error_code& error, std::size_t) {
    if (!error) self->on_request();
  });
}

void WebServer::Impl::Connection::on_request() {
  const Request& request = parser_->get();
  const std::string_view host = view_of(request[http::field::host]);
  if (websocket::is_upgrade(request) && request.target() == "/stream" && is_plain_host(host) &&
      view_of(request[http::field::origin]) == "http://" + std::string(host)) {
    const auto stream = std::make_shared<Stream>(server_, std::move(tcp_));
    server_->streams_.push_back(stream);
    stream->open(request);
    return;
  }
  response_ = server_->answer(request);
  response_.keep_alive(request.keep_alive());
  http::async_write(tcp_, response_, [self = shared_from_this()](const error_code& error, std::size_t) {
    if (!error && self->response_.keep_alive()) return self->read();
    error_code ignored;
    self->tcp_.socket().shutdown(tcp::socket::shutdown_send, ignored);
  });
}

Response WebServer::Impl::answer(const Request& request) const {
  Response response;
  response.version(request.version());
  response.set(http::field::cache_control, "no-store");
  response.set(http::field::content_type, "text/plain; charset=utf-8");
  const std::string path(view_of(request.target()).substr(0, request.target().find('?')));
  const auto file = files_.find(path);
  if (!is_plain_host(view_of(request[http::field::host]))) {
    response.result(http::status::forbidden);
    response.body() = span_of("Open this page by the computer's IP address or as localhost.\n");
  } else if (path == "/stream") {
    response.result(http::status::forbidden);
    response.body() = span_of("The stream is for this server's own page.\n");
  } else if (request.method() != http::verb::get && request.method() != http::verb::head) {
    response.result(http::status::method_not_allowed);
    response.body() = span_of("Only GET and HEAD.\n");
  } else if (file == files_.end()) {
    response.result(http::status::not_found);
    response.body() = span_of("There is no such page.\n");
  } else {
    response.set(http::field::content_type, file->second.type);
    if (request.method() == http::verb::get) response.body() = span_of(file->second.content);
  }
  response.prepare_payload();
  return response;
}

void WebServer::Impl::accept() {
  acceptor_.async_accept([self = shared_from_this()](const error_code& error, tcp::socket socket) {
    if (error == asio::error::operation_aborted) return;
    if (!error && self->num_connections_ < kMaxConnections)
      std::make_shared<Connection>(self, std::move(socket))->read();
    self->accept();
  });
}

void WebServer::Impl::tick() {
  timer_.expires_after(kFrame);
  streams_.remove_if([](const std::weak_ptr<Stream>& stream) { return stream.expired(); });
  for (const auto& stream : streams_)
    if (const auto watching = stream.lock()) watching->tick();
  timer_.async_wait([self = shared_from_this()](const error_code& error) {
    if (!error) self->tick();
  });
}

void WebServer::Impl::stop() {
  error_code ignored;
  acceptor_.close(ignored);
  timer_.cancel();
  for (const auto& stream : streams_)
    if (const auto watching = stream.lock()) watching->close();
}

WebServer::WebServer(asio::io_context& io, const std::string& address, int port, Files files, MakeClient make_client)
    : impl_(std::make_shared<Impl>(io, std::move(files), std::move(make_client))) {
  impl_->open(address, port);
  impl_->start();
}

WebServer::~WebServer() {
  impl_->stop();
}

int WebServer::port() const {
  return impl_->port();
}

}  // namespace swarm
