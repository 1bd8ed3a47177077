// The motion capture input as a program: datagrams in, the onboard bus out.
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/udp.hpp>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/realtime_host.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using boost::asio::ip::udp;

int port() {
  return base_port() + 102;
}

std::vector<std::string> command(const std::vector<std::string>& more) {
  std::vector<std::string> words = {"mocap_input", "--robot-id",          "3", "--onboard-url", local_url(base_port()),
                                    "--port",      std::to_string(port())};
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

TEST(MocapProgram, PublishesStateAndObstacles) {
  Program program(command({"--body", "drone", "--obstacles", "walker:column:0.6,1.8"}));
  LcmBus bus(local_url(base_port()));
  std::vector<sogm_swarm::robot_state_t> states;
  sogm_swarm::obstacles_t obstacles{};
  bus.subscribe(channel::kRobotState, [&](std::string_view, std::span<const std::uint8_t> bytes) {
    EXPECT_EQ(decode(bytes, &states.emplace_back()), Refusal::kNone);
  });
  bus.subscribe(channel::kObstacles, [&](std::string_view, std::span<const std::uint8_t> bytes) {
    EXPECT_EQ(decode(bytes, &obstacles), Refusal::kNone);
  });
  boost::asio::io_context io;
  udp::socket socket(io, udp::v4());
  const udp::endpoint input(boost::asio::ip::address_v4::loopback(), static_cast<std::uint16_t>(port()));
  const auto say = [&](const std::string& text) {
    boost::system::error_code ignored;
    socket.send_to(boost::asio::buffer(text), input, 0, ignored);
  };
  const Utime begin = wall_utime();
  EXPECT_TRUE(wait_for(15.0, [&] {
    const double t_s = to_seconds(wall_utime() - begin);
    const std::string t = std::to_string(t_s);
    say(R"({"t": )" + t + R"(, "bodies": [{"name": "drone", "position": [)" + t +
        R"(, 2, 1], "quaternion": [1, 0, 0, 0]}, )" +
        R"({"name": "walker", "position": [3, 4, 0.9], "quaternion": [1, 0, 0, 0]}]})");
    bus.drain();
    return states.size() > 50 && obstacles.num_obstacles == 1;
  })) << program.err();
  EXPECT_EQ(states.back().header.robot_id, 3);
  EXPECT_NEAR(states.back().velocity[0], 1.0, 0.05);
  EXPECT_EQ(states.back().position[1], 2.0);
  EXPECT_EQ(obstacles.obstacles.at(0).size[1], 1.8);
  say("nonsense");
  EXPECT_TRUE(wait_for(5.0, [&] {
    return program.err().find("1 datagrams refused; the newest: the datagram is not one JSON object") !=
           std::string::npos;
  })) << program.err();
  EXPECT_TRUE(wait_for(5.0, [&] { return program.err().find("motion capture is silent") != std::string::npos; }))
      << program.err();

  const Finished second = run_program(command({}));
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_NE(second.err.find("cannot listen on 127.0.0.1:" + std::to_string(port()) + ": Address already in use"),
            std::string::npos)
      << second.err;
  program.signal(SIGTERM);
  EXPECT_EQ(program.wait(3.0), 0) << program.err();
}

TEST(MocapProgram, SaysWhatIsWrongWithItsOptions) {
  const auto expect_refused = [](const std::vector<std::string>& options, const std::string& why) {
    const Finished finished = run_program(command(options));
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_NE(finished.err.find(why), std::string::npos) << finished.err;
  };
  expect_refused({"--obstacles", "walker:column:0.6"}, "'walker:column:0.6': a column has 2 sizes");
  expect_refused({"--obstacles", "walker:cone:0.6"}, "the shape must be column, ring, box or sphere");
  expect_refused({"--address", "somewhere"}, "--address somewhere: must be an IPv4 address");
  expect_refused({"--address", "192.0.2.1"}, "cannot listen on 192.0.2.1:");
}

}  // namespace
}  // namespace swarm::test
