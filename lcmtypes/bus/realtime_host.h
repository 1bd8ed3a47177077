// The real-time host: runs nodes over LCM with the computer's clock. The simulator's lock-step host runs the same
// nodes.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/seal.h"

namespace swarm {

// kClock: steady time near to the wall clock, see node_clock.h; the wall clock's steps are taken when the node agrees.
// kMessages: the newest message's time, carried on by the wall clock, so that a replayed log is not refused as old.
enum class TimeSource { kClock, kMessages };

struct HostClock {
  TimeSource source = TimeSource::kClock;
  Duration error{};                       // added, to try what wrong clocks do
  ClockReading (*read)() = &read_clocks;  // others, to try what clocks do that are set
};

// One thread, one event loop, any number of nodes, each with buses of its own.
class RealtimeHost {
 public:
  RealtimeHost();
  ~RealtimeHost();

  // Puts a node on its buses; an empty URL stands for a bus that it has not. `name` is for the log. Throws what LcmBus
  // throws, and std::invalid_argument when the node subscribes to a bus that it has not. `node` must outlive the host.
  // `keys` are of the swarm bus.
  void add(const std::string& name, Node& node, const std::string& onboard_url, const std::string& swarm_url,
           HostClock clock = {}, const SwarmKeys& keys = {});

  // For what reaches a node otherwise than over its buses (a socket, a serial device): calls `with` with the node's
  // time and outbox, then lets the node step. From within run() only; throws std::invalid_argument when the node was
  // not added.
  void deliver(const Node& node, const std::function<void(Utime now, Outbox& outbox)>& with);

  // Until SIGTERM, SIGINT or stop(). What a node throws comes out here. systemd is told that it runs, see
  // service_manager.h.
  void run();
  void stop() { io_.stop(); }

  // Calls look() at the beginning of run() and then every `period`, until it returns false: then run() ends.
  void watch(Duration period, std::function<bool()> look);

  // For whatever else shall happen in the same thread.
  boost::asio::io_context& io() { return io_; }

 private:
  class Seat;
  struct Watch;
  void look(const std::shared_ptr<Watch>& watch);

  boost::asio::io_context io_;
  boost::asio::signal_set signals_;  // held from the start, so that a signal before run() ends run()
  std::vector<std::unique_ptr<Seat>> seats_;
};

// What else shall live in a daemon's event loop: made when the node is on its buses, gone before the host is.
using Attachment = std::function<std::shared_ptr<void>(RealtimeHost&)>;

enum class DaemonBuses { kOnboard, kOnboardAndSwarm, kSwarm };

// All of a daemon's main(): `declare` adds the node's options; --onboard-url, --swarm-url, --key-file and --insecure,
// as far as it has these buses, come with it;
// `make_node` is called when they are read, `attach` (if any) after it. Returns 2 after one line on stderr for whatever
// is wrong with options, node, buses or attachment.
int daemon_main(const std::string& program, const std::string& usage, int argc, const char* const* argv,
                DaemonBuses buses, const std::function<void(OptionSet&)>& declare,
                const std::function<std::unique_ptr<Node>()>& make_node, const Attachment& attach = nullptr);

}  // namespace swarm
