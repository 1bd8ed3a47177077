#include "lcmtypes/bus/realtime_host.h"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdlib>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <utility>

#include "lcmtypes/bus/big_endian.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/recurring.h"
#include "lcmtypes/bus/service_manager.h"

namespace swarm {
namespace {

using std::chrono::steady_clock;

// The longest sleep: a system clock that jumps is noticed within it.
constexpr Duration kMaxSleep = 100ms;
// A wake-up may be so late: less than the kernel's own slack.
constexpr Duration kTimerSlack = 20us;
// A replayed message whose time is farther off than this is of another part of the log.
constexpr Duration kReplayJump = 50ms;

// Characters of channels that are named in the log: who keeps many cells listens to thousands.
constexpr std::size_t kMostNamed = 300;

// Lets one warning per second pass.
class RateLimit {
 public:
  bool pass() {
    const auto now = steady_clock::now();
    if (last_ && now - *last_ < 1s) return false;
    last_ = now;
    return true;
  }

 private:
  std::optional<steady_clock::time_point> last_;
};

void check_url(const std::string& url) {
  try {
    UdpmUrl::parse(url);
  } catch (const std::invalid_argument& error) {
    throw OptionError(error.what());
  }
}

SwarmKeys read_keys(const std::string& file, bool insecure) {
  if (insecure) return {};
  if (file.empty()) {
    throw OptionError(
        "--key-file: must name the file with the swarm's key (tools/new_key makes one), or --insecure true "
        "be given, and whoever is on the network be believed");
  }
  return SwarmKeys::read(file);
}

// Says again and again that there is no key.
class InsecureReminder {
 public:
  explicit InsecureReminder(boost::asio::io_context& io) : timer_(io) {}
  void remind() {
    spdlog::warn("--insecure: there is no key, whoever is on the swarm bus is believed");
    timer_.expires_after(60s);
    timer_.async_wait([this](const boost::system::error_code& error) {
      if (!error) remind();
    });
  }

 private:
  boost::asio::steady_timer timer_;
};

}  // namespace

// A node, its buses and its wake-ups.
class RealtimeHost::Seat : public Outbox {
 public:
  Seat(boost::asio::io_context& io, std::string name, Node& node, const std::string& onboard_url,
       const std::string& swarm_url, HostClock clock, const SwarmKeys& keys)
      : name_(std::move(name)), node_(node), config_(clock), clock_(clock.read()), timer_(io) {
    open(io, BusId::kOnboard, onboard_url, {});
    open(io, BusId::kSwarm, swarm_url, keys);
    std::array<std::string, 2> channels;
    for (const Subscription& subscription : node_.subscriptions()) {
      const BusId id = subscription.bus;
      if (!port(id).bus)
        throw std::invalid_argument(name_ + " listens to " + subscription.channel + " on a bus without URL");
      auto& patient = port(id).patient;
      // Replayed messages tell what time it is when they come.
      const bool can_wait = subscription.wakes == Wakes::kNobody && config_.source == TimeSource::kClock;
      if (can_wait && !patient)
        patient =
            id == BusId::kOnboard ? std::make_unique<LcmBus>(onboard_url) : std::make_unique<LcmBus>(swarm_url, keys);
      const auto& bus = can_wait ? patient : port(id).bus;
      subscribe(*bus, id, subscription.channel);
      channels[static_cast<std::size_t>(id)] += " " + subscription.channel;
    }
    for (const BusId id : {BusId::kOnboard, BusId::kSwarm}) {
      const auto& bus = port(id).bus;
      if (!bus) continue;
      std::string& heard = channels[static_cast<std::size_t>(id)];
      if (const std::size_t end = heard.find(' ', kMostNamed); end != std::string::npos)
        heard.replace(end, heard.npos, " ...");
      spdlog::info("{}: {} bus {}, listens to{}", name_, id == BusId::kOnboard ? "onboard" : "swarm",
                   bus->url().to_string(), heard.empty() ? " nothing" : heard);
      for (const std::string& warning : bus->warnings()) spdlog::warn("{}: {}", name_, warning);
    }
  }

  void start() {
    for (Port& port : ports_) {
      if (port.bus) await_messages(port);
    }
    look_.done(now());
    step();
  }

  bool holds(const Node& node) const { return &node_ == &node; }
  void deliver(const std::function<void(Utime, Outbox&)>& with) {
    with(now(), *this);
    step();
  }

  void publish_bytes(BusId id, std::string_view channel, std::span<const std::uint8_t> bytes) override {
    const auto& bus = port(id).bus;
    const bool sent = bus && bus->publish(channel, bytes);
    if (!sent && send_warnings_.pass()) spdlog::warn("{}: could not send {} ({} bytes)", name_, channel, bytes.size());
  }
  void listen(BusId id, std::string_view channel, bool listens) override {
    const auto& bus = port(id).bus;
    if (!bus) throw std::invalid_argument(name_ + " listens to " + std::string(channel) + " on a bus without URL");
    bus->unsubscribe(channel);
    if (listens) subscribe(*bus, id, std::string(channel));
  }

 private:
  struct Port {
    std::unique_ptr<LcmBus> bus;
    std::unique_ptr<LcmBus> patient;  // where pending messages wake nobody; none: no channel is so
    std::optional<boost::asio::posix::stream_descriptor> descriptor;
    std::int64_t forged_told = 0;
  };

  void subscribe(LcmBus& bus, BusId id, const std::string& channel) {
    bus.subscribe(channel, [this, id](std::string_view name, std::span<const std::uint8_t> bytes) {
      if (config_.source == TimeSource::kMessages) follow(bytes);
      node_.on_message(watch_clock(), id, name, bytes, *this);
    });
  }

  Port& port(BusId id) { return ports_[static_cast<std::size_t>(id)]; }

  void open(boost::asio::io_context& io, BusId id, const std::string& url, const SwarmKeys& keys) {
    if (url.empty()) return;
    Port& opened = port(id);
    opened.bus = std::make_unique<LcmBus>(url, keys);
    opened.descriptor.emplace(io, ::dup(opened.bus->fd()));  // the bus closes its own, Asio the copy
  }

  void await_messages(Port& port) {
    port.descriptor->async_wait(boost::asio::posix::stream_descriptor::wait_read,
                                [this, &port](const boost::system::error_code& error) {
                                  if (error) throw std::runtime_error(name_ + ": bus lost: " + error.message());
                                  port.bus->drain();
                                  tell_of_forged(port);
                                  step();
                                  await_messages(port);
                                });
  }

  void tell_of_forged(Port& port) {
    const std::int64_t forged = port.bus->forged() - port.forged_told;
    if (forged == 0 || !forged_warnings_.pass()) return;
    spdlog::warn("{}: {} messages on the swarm bus were not sealed with this swarm's key", name_, forged);
    port.forged_told = port.bus->forged();
  }

  void step() {
    for (Port& port : ports_) {
      if (port.patient) port.patient->drain();
    }
    const Utime time = watch_clock();
    const auto begun = steady_clock::now();
    const Utime next = node_.step(time, *this);
    tell_activity(time);
    wake_at(begun + std::clamp(next - time, Duration(), kMaxSleep));
  }

  // A timer that goes off too early costs less than one that is set anew after each message.
  void wake_at(steady_clock::time_point time) {
    if (is_timer_set_ && timer_.expiry() <= time + kTimerSlack) return;
    timer_.expires_at(time);
    is_timer_set_ = true;
    timer_.async_wait([this](const boost::system::error_code& error) {
      if (error) return;
      is_timer_set_ = false;
      step();
    });
  }

  void tell_activity(Utime time) {
    if (time < look_.due(time, ActivityLog::kPeriod)) return;
    look_.done(time);
    const auto line = activity_log_.update(time, node_.activity(time));
    if (line) spdlog::log(line->is_warning ? spdlog::level::warn : spdlog::level::info, "{}: {}", name_, line->text);
  }

  Utime now() {
    const ClockReading reading = config_.read();
    const Utime steady = clock_.read(reading);
    return (config_.source == TimeSource::kClock ? steady : reading.wall + replay_offset_) + config_.error;
  }

  // Replayed messages are old: their time is now. The header's utime has the same place in every message.
  void follow(std::span<const std::uint8_t> bytes) {
    constexpr std::size_t kUtimeAt = 28;
    if (bytes.size() < kUtimeAt + 8) return;
    const std::uint64_t utime = read_big_endian(bytes.subspan(kUtimeAt, 8));
    if (utime > static_cast<std::uint64_t>(to_us(kMaxUtime))) return;
    const Duration offset = to_utime(static_cast<std::int64_t>(utime)) - config_.read().wall;
    if (std::chrono::abs(offset - replay_offset_) > kReplayJump) replay_offset_ = offset;
  }

  // Tells the node of steps of the wall clock, and takes them when it agrees. What time it is then.
  Utime watch_clock() {
    const Utime time = now();
    const auto step_ms = clock_.step() / 1ms;
    const NodeClock::Offer offer = clock_.offer_step(
        [&](Duration step) { return config_.source == TimeSource::kMessages || node_.on_clock_step(time, step); });
    if (offer == NodeClock::Offer::kTaken && clock_warnings_.pass())
      spdlog::warn("{}: the system clock jumped by {} ms", name_, step_ms);
    if (offer == NodeClock::Offer::kRefused)
      spdlog::warn("{}: the system clock jumped by {} ms, which is taken over when the robot rests", name_, step_ms);
    return offer == NodeClock::Offer::kTaken ? now() : time;
  }

  std::string name_;
  Node& node_;
  HostClock config_;
  NodeClock clock_;
  Duration replay_offset_{};
  std::array<Port, 2> ports_;
  boost::asio::steady_timer timer_;
  bool is_timer_set_ = false;
  ActivityLog activity_log_;
  Recurring look_;  // at what the node is about
  RateLimit send_warnings_, clock_warnings_, forged_warnings_;
};

RealtimeHost::RealtimeHost() : signals_(io_, SIGINT, SIGTERM) {}
RealtimeHost::~RealtimeHost() = default;

void RealtimeHost::add(const std::string& name, Node& node, const std::string& onboard_url,
                       const std::string& swarm_url, HostClock clock, const SwarmKeys& keys) {
  seats_.push_back(std::make_unique<Seat>(io_, name, node, onboard_url, swarm_url, clock, keys));
}

void RealtimeHost::deliver(const Node& node, const std::function<void(Utime, Outbox&)>& with) {
  const auto seat = std::ranges::find_if(seats_, [&](const auto& other) { return other->holds(node); });
  if (seat == seats_.end()) throw std::invalid_argument("delivery to a node that is not in this host");
  (*seat)->deliver(with);
}

struct RealtimeHost::Watch {
  boost::asio::steady_timer timer;
  Duration period;
  std::function<bool()> look;
};

void RealtimeHost::watch(Duration period, std::function<bool()> look) {
  const auto watch = std::make_shared<Watch>(Watch{boost::asio::steady_timer(io_), period, std::move(look)});
  boost::asio::post(io_, [this, watch] { this->look(watch); });
}

void RealtimeHost::look(const std::shared_ptr<Watch>& watch) {
  if (!watch->look()) return stop();
  watch->timer.expires_after(watch->period);
  watch->timer.async_wait([this, watch](const boost::system::error_code& error) {
    if (!error) look(watch);
  });
}

void RealtimeHost::run() {
  signals_.async_wait([this](const boost::system::error_code& error, int signal) {
    if (error) return;
    spdlog::info("stopped by {}", signal == SIGINT ? "SIGINT" : "SIGTERM");
    io_.stop();
  });
  for (const auto& seat : seats_) seat->start();
  ServiceManager service_manager(io_);
  service_manager.begin();
  io_.run();
}

int daemon_main(const std::string& program, const std::string& usage, int argc, const char* const* argv,
                DaemonBuses buses, const std::function<void(OptionSet&)>& declare,
                const std::function<std::unique_ptr<Node>()>& make_node, const Attachment& attach) {
  try {
    spdlog::set_default_logger(
        std::make_shared<spdlog::logger>(program, std::make_shared<spdlog::sinks::stderr_color_sink_mt>()));
    spdlog::set_pattern("%Y-%m-%d %H:%M:%S.%e %^%l%$ %v");
    std::string onboard_url = buses == DaemonBuses::kSwarm ? "" : kDefaultOnboardUrl;
    std::string swarm_url = buses == DaemonBuses::kOnboard ? "" : kDefaultSwarmUrl;
    OptionSet options(program, usage);
    declare(options);
    bool replay = false;
    double clock_offset_ms = 0.0;
    options.add("replay", &replay, "take the time from the messages instead of the clock: for replayed logs");
    options.add("clock-offset-ms", &clock_offset_ms, -10'000, 10'000, "ms",
                "added to this computer's clock, to try what wrong clocks do");
    if (!onboard_url.empty())
      options.add("onboard-url", &onboard_url, "bus inside the robot, one port per robot", check_url);
    std::string key_file;
    bool insecure = false;
    if (!swarm_url.empty()) {
      options.add("swarm-url", &swarm_url, "bus between the robots, another port", check_url);
      options.add("key-file", &key_file,
                  "the key that all robots of the swarm share: what peers say is sealed with it");
      options.add("insecure", &insecure,
                  "fly without a key, whatever --key-file says: believe whoever speaks on the swarm bus");
    }
    if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return EXIT_SUCCESS;
    const SwarmKeys keys = swarm_url.empty() ? SwarmKeys() : read_keys(key_file, insecure);
    const std::unique_ptr<Node> node = make_node();
    const HostClock clock{replay ? TimeSource::kMessages : TimeSource::kClock, to_duration(1e-3 * clock_offset_ms)};
    RealtimeHost host;
    host.add(program, *node, onboard_url, swarm_url, clock, keys);
    InsecureReminder reminder(host.io());
    if (insecure) reminder.remind();
    const std::shared_ptr<void> attached = attach ? attach(host) : nullptr;
    host.run();
    return EXIT_SUCCESS;
  } catch (const std::exception& error) {
    std::cerr << program << ": " << error.what() << std::endl;
    return 2;
  }
}

}  // namespace swarm
