// Datagrams of motion capture, any text or well-formed ones, and the rules of what is an obstacle: what is published is
// valid.
#include "tools/bridge/mocap_node.h"

#include <cmath>

#include "tests/fuzz/fuzz_node.h"

namespace swarm::fuzz {
namespace {

class Bench : public NodeBench<Bench, MocapNode> {
 public:
  explicit Bench(const MocapConfig& config) : NodeBench(config, 1) { step(); }

  void on_datagram(std::string_view text) {
    const Bytes copy(text.begin(), text.end());
    const std::int64_t before = node.report().datagrams;
    node.on_datagram(now, copy, *this);
    std::int64_t refused = 0;
    for (const std::int64_t count : node.report().refused) refused += count;
    expect(node.report().datagrams + refused == ++datagrams_, "a datagram is taken or refused");
    if (node.report().datagrams == before) expect(!node.report().words.empty(), "it is said why");
  }

 private:
  std::int64_t datagrams_ = 0;
};

std::string make_datagram(FuzzInput& input, double t_s) {
  const char* names[] = {"robot1", "ring1", "ring2", "box", "person", "x"};
  const auto number = [&](double reach) {
    return std::to_string(input.byte() % 32 == 0 ? input.any_real() : input.real(-reach, reach));
  };
  std::string text = "{\"t\": " + (input.byte() % 32 == 0 ? "null" : std::to_string(t_s)) + ", \"bodies\": [";
  const int count = input.byte() % 8;
  for (int i = 0; i < count; ++i) {
    const double yaw = input.real(-3.14, 3.14);
    text += std::string(i > 0 ? "," : "") + "{\"name\": \"" + names[input.byte() % 6] + "\", \"position\": [" +
            number(5) + "," + number(5) + "," + number(5) + "], \"quaternion\": [" + std::to_string(std::cos(yaw / 2)) +
            ",0,0," + std::to_string(std::sin(yaw / 2)) + "]}";
  }
  return text + "]}";
}

}  // namespace

void try_input(FuzzInput input) {
  MocapConfig config;
  config.robot_id = Bench::kRobot;
  config.body = "robot1";
  config.obstacles = "ring*:ring:0.8,0.1;box:box:1,2,3:0.1,0,0;person:column:0.5,1.8:0,0,-0.9;x:sphere:0.4";
  if (input.flag()) {
    config.obstacles = input.text();
    try {
      (void)parse_obstacle_rules(config.obstacles);
    } catch (const OptionError&) {
      return;
    }
  }
  Bench bench(config);
  double t_s = 10.0;
  while (!input.empty()) {
    bench.run_for(Bench::duration(input));
    t_s += input.byte() % 16 == 0 ? input.real(-2, 2) : 0.01;
    if (input.flag()) {
      bench.on_datagram(input.text());
    } else {
      bench.on_datagram(make_datagram(input, t_s));
    }
  }
}

}  // namespace swarm::fuzz
