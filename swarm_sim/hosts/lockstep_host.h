// The lock-step host: runs nodes on a simulated clock and simulated buses, as fast as the computer can. An event queue;
// what the messages are it does not know.
//
// Events run in the order (time, seat, sequence), the crashes of a moment after everything else of it. What reaches
// different robots at the same moment runs at the same time, for nothing that is said then is heard then; what they say
// goes out in the order of the seats. So the same nodes give the same bytes on the buses, with any number of threads.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <queue>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/node.h"
#include "swarm_sim/hosts/radio_channel.h"
#include "swarm_sim/hosts/worker_threads.h"

namespace swarm {

class LockstepHost {
 public:
  // Makes a node, at the start and after each crash; the node before it is gone by then.
  using NodeFactory = std::function<std::unique_ptr<Node>()>;
  // How much later than over a perfect bus the copies of a message arrive that one robot sends to another at `now`;
  // none: it is lost. Valid until the next call.
  using Link = std::function<std::span<const Duration>(int from_robot, int to_robot, Utime now)>;
  // Everything that is sent, when it is sent, by which robot.
  using Listener = std::function<void(Utime now, BusId bus, int robot_id, std::string_view channel,
                                      std::span<const std::uint8_t> bytes)>;

  // Where a node sits. Seats of one robot follow each other, or with several threads its nodes may run at the same
  // time.
  struct Seat {
    int robot_id = 0;
    std::string onboard = "", swarm = "";  // names of its buses; empty: it has none
    Duration work{};                       // that its messages take longer, for what it has to do first
    Duration clock_offset{};               // its clock is ahead of the simulated one; see node_clock.h
    bool is_alone = false;                 // its node shares state with others': it never runs at the same time
  };

  // The simulated clock begins at `begin`. So many `threads` run nodes, each those of one robot at a time.
  explicit LockstepHost(Utime begin, int threads = 1);
  ~LockstepHost();
  LockstepHost(const LockstepHost&) = delete;
  LockstepHost& operator=(const LockstepHost&) = delete;

  // A bus on which messages take `delay`, more than nothing (std::invalid_argument); `link` (may be null) is asked for
  // those between different robots. With a `radio`, which must outlive the host, those between robots go over it before
  // that.
  void add_bus(const std::string& name, Duration delay, Link link = nullptr, RadioChannel* radio = nullptr);
  // Makes a node and puts it on its buses. Seats are numbered from 0 in the order in which they are added. Throws
  // std::out_of_range when it subscribes to a bus that there is not.
  std::size_t add(const Seat& seat, NodeFactory make_node);
  // The node of a seat crashes at `at` and is made again at `back` of the simulated clock; what reaches it meanwhile is
  // lost.
  void crash(std::size_t seat, Utime at, Utime back);
  // Somebody sets the clock of a seat at `at` of the simulated clock. The node takes it as in the real-time host.
  void step_clock(std::size_t seat, Utime at, Duration by);
  void listen(Listener listener) { listener_ = std::move(listener); }

  // Until stop(). Throws std::out_of_range when a node sends to a bus that it has not.
  void run();
  // Ends run() after all events of the present moment.
  void stop() { stopped_ = true; }

  Utime now() const { return now_; }

 private:
  class Place;
  struct Bus {
    Duration delay{};
    Link link{};
    RadioChannel* radio = nullptr;
    Utime radio_wake = kNever;  // the wake-up in force; other entries in the queue are void
    std::map<std::string, std::vector<std::size_t>, std::less<>> places{};  // that listen, ascending, by channel
  };
  using Bytes = std::shared_ptr<const std::vector<std::uint8_t>>;
  enum class What : std::uint8_t { kMessage, kWake, kCrash, kRestart, kClock, kRadio };
  // Places that hear a message: all, those of the robot that sends it, all others.
  enum class Whose : std::uint8_t { kAll, kOwn, kOthers };
  struct Message {
    int robot_id;  // of the sender
    BusId bus;
    std::string channel;
    Bytes bytes;
    Duration takes;
  };
  struct Event {
    Utime time;
    std::size_t order;  // the place, or behind all of them
    std::int64_t sequence;
    std::size_t place;
    What what;
    BusId bus = BusId::kOnboard;
    std::string channel{};
    Bytes bytes{};
    Duration by{};       // of kClock
    Bus* air = nullptr;  // of kRadio

    bool operator>(const Event& other) const;
  };

  void push(Utime time, std::size_t place, What what, Duration by = {});
  void send(const Place& from, BusId bus, std::string channel, Bytes bytes);
  void listen(std::size_t place, Bus* bus, const std::string& channel, bool listens);
  void deliver(const Bus& bus, const Message& message, Whose whose);
  void wake_radio(Bus* air);
  void handle_last(const Event& event);  // that comes behind all else of its moment
  void handle_batch();

  Utime now_;
  bool stopped_ = false;
  std::int64_t sequence_ = 0;
  std::map<std::string, Bus> buses_;
  std::vector<std::unique_ptr<Place>> places_;
  std::priority_queue<Event, std::vector<Event>, std::greater<>> events_;
  std::vector<Event> batch_;  // of messages and wake-ups, all of one moment
  struct Group {              // of these: of one robot, or of a seat that is alone
    std::size_t begin, end;
    bool is_alone;
  };
  std::vector<Group> groups_;
  WorkerThreads workers_;
  Listener listener_;
};

}  // namespace swarm
