// The bridge as a program: onboard bus on one side, an autopilot behind UDP or a serial device on the other.
#include <sys/stat.h>
#include <termios.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/udp.hpp>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/realtime_host.h"
#include "planner_daemon/trajectory/motion.h"
#include "tests/support/harness.h"
#include "tests/support/simulated_autopilot.h"

namespace swarm::test {
namespace {

using boost::asio::ip::udp;

constexpr int kRobot = 3;
constexpr mavlink::Sender kController{1, 1}, kBridge{1, 191};

// The autopilot's end of a link, which never blocks.
class Endpoint {
 public:
  virtual ~Endpoint() = default;
  virtual void send(std::span<const std::uint8_t> bytes) = 0;
  virtual Bytes receive() = 0;  // what there is; may be nothing
};

class UdpEndpoint : public Endpoint {
 public:
  explicit UdpEndpoint(int port = 0)
      : socket_(io_, udp::endpoint(boost::asio::ip::address_v4::loopback(), static_cast<std::uint16_t>(port))) {
    socket_.non_blocking(true);
  }
  void send(std::span<const std::uint8_t> bytes) override {
    boost::system::error_code ignored;
    socket_.send_to(boost::asio::buffer(bytes.data(), bytes.size()), to, 0, ignored);
  }
  Bytes receive() override {
    Bytes all;
    for (boost::system::error_code error;;) {
      std::array<std::uint8_t, 2048> datagram;
      udp::endpoint from;
      const std::size_t size = socket_.receive_from(boost::asio::buffer(datagram), from, 0, error);
      if (error) return all;
      to = from;
      all.insert(all.end(), datagram.begin(), datagram.begin() + static_cast<std::ptrdiff_t>(size));
    }
  }
  void connect_to(int port) {
    to = udp::endpoint(boost::asio::ip::address_v4::loopback(), static_cast<std::uint16_t>(port));
  }
  int port() const { return socket_.local_endpoint().port(); }

  udp::endpoint to;

 private:
  boost::asio::io_context io_;
  udp::socket socket_;
};

// The other end of a pseudo-terminal.
class SerialEndpoint : public Endpoint {
 public:
  SerialEndpoint() : fd_(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)) {
    if (fd_ < 0 || ::grantpt(fd_) != 0 || ::unlockpt(fd_) != 0) throw std::runtime_error("no pseudo-terminal");
  }
  ~SerialEndpoint() override { ::close(fd_); }
  void send(std::span<const std::uint8_t> bytes) override {
    EXPECT_EQ(::write(fd_, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  Bytes receive() override {
    Bytes bytes(4096);
    const ssize_t size = ::read(fd_, bytes.data(), bytes.size());
    bytes.resize(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
    return bytes;
  }
  std::string device() const { return ::ptsname(fd_); }
  termios settings() const {
    termios settings{};
    EXPECT_EQ(::tcgetattr(fd_, &settings), 0);
    return settings;
  }

 private:
  int fd_;
};

int link_port() {
  return base_port() + 101;
}

// The program with an autopilot on one side and the onboard bus on the other.
struct Bridge {
  Bridge(const std::string& link, Endpoint& endpoint_in, const std::vector<std::string>& more = {})
      : endpoint(endpoint_in), program(words(link, more)) {
    bus.subscribe(channel::kRobotState, [this](std::string_view, std::span<const std::uint8_t> bytes) {
      sogm_swarm::robot_state_t state;
      EXPECT_EQ(decode(bytes, &state), Refusal::kNone);
      states.push_back(state);
    });
  }
  static std::vector<std::string> words(const std::string& link, const std::vector<std::string>& more) {
    std::vector<std::string> all = {
        "mavlink_bridge", "--robot-id", std::to_string(kRobot), "--onboard-url", local_url(base_port()),
        "--link",         link};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }

  // For a while, or until `enough`: the autopilot reports its state at 50 Hz.
  bool live(
      double seconds, const std::function<bool()>& enough = [] { return false; }) {
    return wait_for(seconds, [&] {
      autopilot.receive(endpoint.receive());
      if (++ticks % 2 == 0) autopilot.report_state(static_cast<std::uint32_t>(10 * ticks));
      if (ticks % 50 == 1) autopilot.report_heartbeat(true);
      bus.drain();
      return enough();
    });
  }
  bool logs(const std::string& text) const { return program.err().find(text) != std::string::npos; }
  bool heard() const { return !autopilot.heartbeats.empty(); }

  // The broadcast daemon's part.
  void say(const Trajectory& trajectory) {
    const Utime now = wall_utime();
    const MotionState state = trajectory.at(now);
    sogm_swarm::setpoint_t setpoint{};
    setpoint.header = make_header(kRobot, 1, seq, now);
    Eigen::Map<Eigen::Vector3d>(setpoint.position) = state.position;
    Eigen::Map<Eigen::Vector3d>(setpoint.velocity) = state.velocity;
    EXPECT_TRUE(bus.publish(channel::kSetpoint, encoded(setpoint)));
    if (seq++ % 5 != 0) return;
    sogm_swarm::announcement_t announcement{};
    announcement.header = make_header(kRobot, 1, seq, now);
    announcement.radius = 0.2f;
    announcement.committed = trajectory.to_wire();
    announcement.least_delay_us = sogm_swarm::announcement_t::kUnknown;
    EXPECT_TRUE(bus.publish(channel::kOwnTrajectory, encoded(announcement)));
  }

  Endpoint& endpoint;
  LcmBus bus{local_url(base_port())};
  SimulatedAutopilot autopilot{kController, kBridge, [this](auto bytes) { endpoint.send(bytes); }};
  std::vector<sogm_swarm::robot_state_t> states;
  std::int64_t seq = 0;
  int ticks = 0;
  Program program;
};

// Where a target is in W, all options at their defaults.
Eigen::Vector3d place_of(const mavlink::SetPositionTargetLocalNed& target) {
  return {target.position[0], -target.position[1], -target.position[2]};
}
double distance_to(const Trajectory& trajectory, const Eigen::Vector3d& place) {
  double least_m = INFINITY;
  for (Utime t = trajectory.start_utime(); t <= trajectory.end_utime(); t += 1ms)
    least_m = std::min(least_m, (trajectory.at(t).position - place).norm());
  return least_m;
}

// Takes off when the bridge hears the bus, loses its broadcast daemon in mid-flight, comes to rest, and is left alone.
void expect_flight(Bridge& bridge) {
  ASSERT_TRUE(bridge.live(10.0, [&] { return bridge.heard(); })) << bridge.program.err();
  const Trajectory hover = Trajectory::hover(1, wall_utime(), {0, 0, 1});
  ASSERT_TRUE(bridge.live(10.0, [&] {
    bridge.say(hover);
    return bridge.autopilot.targets.size() > 20 && bridge.states.size() > 20;
  })) << bridge.program.err();
  EXPECT_LT((place_of(bridge.autopilot.targets.back()) - Eigen::Vector3d(0, 0, 1)).norm(), 1e-6);

  MotionState start;
  start.position = {0, 0, 1};
  const Trajectory trajectory = quintic_to(start, wall_utime() + 50ms, {1, -0.5, 1.5}, 1.5);
  bridge.live(0.6, [&] {
    bridge.say(trajectory);
    return false;
  });
  const std::size_t at_crash = bridge.autopilot.targets.size();
  EXPECT_TRUE(bridge.live(10.0, [&] { return bridge.logs("trajectory ended: nothing is sent any more"); }))
      << bridge.program.err();
  bridge.live(0.1);
  const std::size_t at_end = bridge.autopilot.targets.size();
  EXPECT_GT(at_end, at_crash + (kSanitized ? 20 : 150));  // nearly a second to the end, and one at rest
  for (const auto& target : bridge.autopilot.targets)
    ASSERT_LT(distance_to(trajectory, place_of(target)), 2e-3) << place_of(target).transpose();
  EXPECT_LT((place_of(bridge.autopilot.targets.back()) - Eigen::Vector3d(1, -0.5, 1.5)).norm(), 1e-6);
  bridge.live(0.5);
  EXPECT_EQ(bridge.autopilot.targets.size(), at_end);
  for (const char* line : {"the controller is there", "the controller is armed, offboard mode", "following setpoints",
                           "following the committed trajectory"})
    EXPECT_TRUE(bridge.logs(line)) << line << "\n" << bridge.program.err();

  const sogm_swarm::robot_state_t& state = bridge.states.back();
  EXPECT_EQ(state.header.robot_id, kRobot);
  EXPECT_LT((Eigen::Vector3d(state.position) - Eigen::Vector3d(1, -0.5, 1.5)).norm(), 1e-6);
  EXPECT_NEAR(to_seconds(wall_utime() - to_utime(state.header.utime)), 0.0, 0.2);
  EXPECT_EQ(bridge.autopilot.parser().skipped(mavlink::Skipped::kChecksum), 0);
  bridge.program.signal(SIGTERM);
  EXPECT_EQ(bridge.program.wait(3.0), 0) << bridge.program.err();
}

TEST(BridgeProgram, FliesOverUdpWhereItWaitsForTheController) {
  UdpEndpoint endpoint;
  endpoint.connect_to(link_port());
  Bridge bridge("udp:" + std::to_string(link_port()), endpoint);
  expect_flight(bridge);
}

TEST(BridgeProgram, FliesOverUdpWhereTheControllerWaits) {
  UdpEndpoint endpoint;
  Bridge bridge("udp:localhost:" + std::to_string(endpoint.port()), endpoint);
  expect_flight(bridge);
}

TEST(BridgeProgram, FliesOverASerialDevice) {
  SerialEndpoint endpoint;
  Bridge bridge("serial:" + endpoint.device() + ":921600", endpoint);
  expect_flight(bridge);
}

// With the daemon itself in place of what the tests say for it: it takes its place from the autopilot, flies a
// candidate, and is killed in mid-flight.
TEST(BridgeProgram, OutlivesTheBroadcastDaemon) {
  UdpEndpoint endpoint;
  endpoint.connect_to(link_port());
  Bridge bridge("udp:" + std::to_string(link_port()), endpoint);
  Program daemon({"broadcast_daemon", "--robot-id", std::to_string(kRobot), "--onboard-url", local_url(base_port()),
                  "--swarm-url", local_url(base_port() + 1), "--insecure", "true"});
  std::optional<Motion> motion;
  bridge.bus.subscribe(channel::kOwnTrajectory, [&](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::announcement_t message;
    EXPECT_EQ(decode(bytes, &message), Refusal::kNone);
    motion = motion_of(message);
  });
  ASSERT_TRUE(bridge.live(10.0, [&] { return motion && bridge.autopilot.targets.size() > 20; }))
      << bridge.program.err() << daemon.err();
  const Utime begin = wall_utime() + 300ms;
  const Trajectory flight = quintic_to(motion->at(begin), begin, {0.8, 0.4, 0.6}, 2.0);
  sogm_swarm::candidate_t candidate{};
  candidate.header = make_header(kRobot, 1, 0, wall_utime());
  candidate.trajectory = flight.to_wire();
  ASSERT_TRUE(bridge.bus.publish(channel::kCandidate, encoded(candidate)));
  ASSERT_TRUE(bridge.live(10.0, [&] { return wall_utime() > begin + 800ms; }));
  EXPECT_GT(place_of(bridge.autopilot.targets.back()).x(), 0.1) << daemon.err();
  EXPECT_LT(place_of(bridge.autopilot.targets.back()).x(), 0.6);
  daemon.signal(SIGKILL);
  EXPECT_TRUE(bridge.live(10.0, [&] { return bridge.logs("trajectory ended: nothing is sent any more"); }))
      << bridge.program.err();
  double fastest_mps = 0.0;
  for (const auto& target : bridge.autopilot.targets) {
    ASSERT_LT(distance_to(flight, place_of(target)), 2e-3) << place_of(target).transpose();
    fastest_mps = std::max<double>(fastest_mps, target.velocity[0]);
  }
  EXPECT_GT(fastest_mps, 0.7);
  EXPECT_LT((place_of(bridge.autopilot.targets.back()) - Eigen::Vector3d(0.8, 0.4, 0.6)).norm(), 1e-6);
  EXPECT_LT((Eigen::Vector3d(bridge.states.back().position) - Eigen::Vector3d(0.8, 0.4, 0.6)).norm(), 1e-6);
}

TEST(BridgeProgram, SetsTheSerialDeviceUpForBytesAsTheyAre) {
  SerialEndpoint endpoint;
  Bridge bridge("serial:" + endpoint.device() + ":57600", endpoint);
  ASSERT_TRUE(bridge.live(10.0, [&] { return bridge.heard(); }));
  const termios settings = endpoint.settings();
  EXPECT_EQ(::cfgetospeed(&settings), speed_t{B57600});
  EXPECT_EQ(settings.c_lflag & (ICANON | ECHO | ISIG), 0u);
  EXPECT_EQ(settings.c_iflag & (IXON | IXOFF | ICRNL | INLCR | ISTRIP), 0u);
  EXPECT_EQ(settings.c_oflag & OPOST, 0u);
  EXPECT_EQ(settings.c_cflag & (CSIZE | PARENB | CSTOPB), static_cast<tcflag_t>(CS8));
}

TEST(BridgeProgram, ASerialDeviceMayVanishAndComeBack) {
  TemporaryDirectory directory;
  const std::string name = directory / "tty";
  auto first = std::make_unique<SerialEndpoint>();
  std::filesystem::create_symlink(first->device(), name);
  std::optional<Bridge> bridge;
  bridge.emplace("serial:" + name + ":115200", *first);
  ASSERT_TRUE(bridge->live(10.0, [&] { return bridge->heard(); })) << bridge->program.err();
  std::filesystem::remove(name);
  first.reset();
  ASSERT_TRUE(wait_for(5.0, [&] { return bridge->logs("lost " + name); })) << bridge->program.err();

  SerialEndpoint second;
  std::filesystem::create_symlink(second.device(), name);
  SimulatedAutopilot autopilot(kController, kBridge, [&](auto bytes) { second.send(bytes); });
  std::uint32_t time_ms = 100'000;
  std::size_t before = 0;
  EXPECT_TRUE(wait_for(10.0, [&] {
    autopilot.receive(second.receive());
    bridge->bus.drain();
    if (autopilot.heartbeats.empty())
      before = bridge->states.size();
    else
      autopilot.report_state(time_ms += 10);
    return bridge->states.size() > before + 5;
  })) << bridge->program.err();
  EXPECT_TRUE(bridge->program.running());
}

// What the device does not take in time is dropped: after a pause the newest setpoints come, not those that waited.
TEST(BridgeProgram, DropsTheOldestWhenTheDeviceIsSlow) {
  SerialEndpoint endpoint;
  Bridge bridge("serial:" + endpoint.device() + ":57600", endpoint);
  const Trajectory hover = Trajectory::hover(1, wall_utime(), {0, 0, 1});
  ASSERT_TRUE(bridge.live(10.0, [&] {
    bridge.say(hover);
    return bridge.autopilot.targets.size() > 20;
  })) << bridge.program.err();
  const Utime before = wall_utime();
  const std::int64_t before_ms = bridge.autopilot.targets.back().time_boot_ms;
  wait_for(4.0, [&] {  // nobody reads
    bridge.say(hover);
    return false;
  });
  bridge.live(0.3, [&] {
    bridge.say(hover);
    return false;
  });
  const auto& targets = bridge.autopilot.targets;
  std::int64_t longest_ms = 0;
  for (std::size_t i = 1; i < targets.size(); ++i) {
    ASSERT_GE(targets[i].time_boot_ms, targets[i - 1].time_boot_ms);
    longest_ms = std::max<std::int64_t>(longest_ms, targets[i].time_boot_ms - targets[i - 1].time_boot_ms);
  }
  const std::int64_t behind_ms = (wall_utime() - before) / 1ms - (targets.back().time_boot_ms - before_ms);
  EXPECT_GT(longest_ms, 500) << targets.size();
  EXPECT_LT(behind_ms, kSanitized ? 500 : 150);
  EXPECT_EQ(bridge.autopilot.parser().skipped(mavlink::Skipped::kChecksum), 0);
}

// Only the controller's own system id makes somebody the controller, and the first stays it.
TEST(BridgeProgram, AnswersTheControllerAndNobodyElse) {
  UdpEndpoint endpoint, stranger, late;
  for (UdpEndpoint* each : {&endpoint, &stranger, &late}) each->connect_to(link_port());
  Bridge bridge("udp:" + std::to_string(link_port()), endpoint);
  SimulatedAutopilot ground({255, 190}, kBridge, [&](auto bytes) { stranger.send(bytes); });
  SimulatedAutopilot twin(kController, kBridge, [&](auto bytes) { late.send(bytes); });
  wait_for(1.0, [&] {
    ground.report_heartbeat(false);
    stranger.send(Bytes(100, 0xFD));
    return false;
  });
  EXPECT_TRUE(stranger.receive().empty());
  ASSERT_TRUE(bridge.live(10.0, [&] { return bridge.heard(); })) << bridge.program.err();
  bridge.live(2.5, [&] {
    twin.report_heartbeat(false);
    ground.report_heartbeat(false);
    return false;
  });
  EXPECT_TRUE(late.receive().empty());
  EXPECT_TRUE(stranger.receive().empty());
  EXPECT_FALSE(bridge.logs("disarmed")) << bridge.program.err();
  // It falls silent: another may take its place.
  EXPECT_TRUE(wait_for(10.0, [&] {
    twin.report_heartbeat(false);
    return !late.receive().empty();
  })) << bridge.program.err();
}

TEST(BridgeProgram, SaysWhatIsWrongWithTheLink) {
  UdpEndpoint taken;
  const auto expect_refused = [](const std::string& link, const std::string& why) {
    const Finished finished = run_program(Bridge::words(link, {}));
    EXPECT_EQ(finished.exit_code, 2) << link;
    EXPECT_NE(finished.err.find(why), std::string::npos) << finished.err;
    EXPECT_NE(finished.err.find("mavlink_bridge: "), std::string::npos) << finished.err;
    EXPECT_NE(finished.err.find(link), std::string::npos) << finished.err;
  };
  expect_refused("udp:" + std::to_string(taken.port()),
                 "cannot listen on 127.0.0.1:" + std::to_string(taken.port()) + ": Address already in use");
  expect_refused("serial:/dev/absent:115200", "cannot be opened: No such file or directory");
  expect_refused("serial:/dev/null:115200", "serial:/dev/null:115200: ");
  SerialEndpoint serial;
  expect_refused("serial:" + serial.device() + ":12345", "baud rate 12345");
  expect_refused("udp:absent.invalid:14550", "no such host 'absent.invalid'");
  expect_refused("udp:0", "the port must be a whole number within [1, 65535]");
  expect_refused("udp:127.0.0.1:", "the port must be");
  expect_refused("udp::14550", "there is no host");
  expect_refused("serial:/dev/ttyUSB0", "must be udp:PORT");
  expect_refused("serial::9600", "there is no device");
  expect_refused("serial:/dev/ttyUSB0:fast", "the baud rate must be");
  expect_refused("tcp:5760", "must be udp:PORT, udp:HOST:PORT or serial:DEVICE:BAUD");
}

}  // namespace
}  // namespace swarm::test
