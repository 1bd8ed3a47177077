// bus_bench: processor time that packing an announcement and hearing one takes, from the socket to the daemon's
// message.
#include <benchmark/benchmark.h>
#include <unistd.h>

#include <cmath>
#include <string>
#include <vector>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/node_clock.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "sogm_swarm/announcement_t.hpp"

namespace swarm {
namespace {

constexpr int kAtOnce = 50;  // fit any receive buffer

// In flight, of a roster of twenty: along a curve, and another one waits for acknowledgements.
sogm_swarm::announcement_t announcement() {
  sogm_swarm::announcement_t message{};
  message.header = HeaderSource(1, 1).next(wall_utime());
  message.radius = 0.2f;
  for (auto* trajectory : {&message.committed, &message.pending}) {
    trajectory->seq = 1;
    trajectory->start_utime = message.header.utime;
    trajectory->piece_us = 200'000;
    trajectory->num_pieces = 10;
    for (int k = 0; k <= 10; ++k) {
      const double u = 0.3 * k, moves = k < 10 ? 1.0 : 0.0;  // 1.5 rad/s, at 2 m/s
      const double values[] = {std::sin(u) / 0.75, std::cos(u) / 0.75, 1.0, 2 * std::cos(u), -2 * std::sin(u), 0.0,
                               -3 * std::sin(u),   -3 * std::cos(u),   0.0};
      for (int i = 0; i < 9; ++i) trajectory->knots[k][i] = static_cast<float>((i < 3 ? 1.0 : moves) * values[i]);
    }
  }
  message.pending_state = message.kAnnounced;
  message.num_acks = 20;
  message.acks.assign(20, {1, 7, 1});
  return message;
}

std::vector<std::uint8_t> packed_bytes() {
  auto message = announcement();
  std::vector<std::uint8_t> bytes;
  encode_packed(&message, &bytes);
  return bytes;
}

void hear(benchmark::State& state, const SwarmKeys& keys, bool is_decoded) {
  LcmBus bus("udpm://239.255.76.68:" + std::to_string(20'000 + ::getpid() % 10'000) + "?ttl=0", keys);
  std::int64_t heard = 0;
  sogm_swarm::announcement_t message;
  bus.subscribe(channel::kAnnouncement, [&](auto, auto bytes) {
    heard += !is_decoded || decode_packed(bytes, &message) == Refusal::kNone ? 1 : 0;
  });
  const std::vector<std::uint8_t> bytes = packed_bytes();
  for (auto _ : state) {
    state.PauseTiming();
    for (int i = 0; i < kAtOnce; ++i) (void)bus.publish(channel::kAnnouncement, bytes);
    state.ResumeTiming();
    while (bus.drain() > 0) continue;
  }
  state.counters["each"] =
      benchmark::Counter(static_cast<double>(heard), benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  state.counters["bytes"] = static_cast<double>(bytes.size());
}

void pack_one(benchmark::State& state) {
  auto message = announcement();
  std::vector<std::uint8_t> bytes;
  for (auto _ : state) {
    encode_packed(&message, &bytes);
    benchmark::DoNotOptimize(bytes.data());
  }
}

void unpack_one(benchmark::State& state) {
  const std::vector<std::uint8_t> bytes = packed_bytes();
  sogm_swarm::announcement_t message;
  std::int64_t good = 0;
  for (auto _ : state) good += decode_packed(bytes, &message) == Refusal::kNone ? 1 : 0;
  state.counters["good"] = benchmark::Counter(static_cast<double>(good), benchmark::Counter::kAvgIterations);
  state.counters["bytes"] = static_cast<double>(bytes.size());
}

void register_all() {
  benchmark::RegisterBenchmark("packed", pack_one);
  benchmark::RegisterBenchmark("unpacked and decoded", unpack_one);
  const auto add = [](const char* name, const SwarmKeys& keys, bool is_decoded) {
    benchmark::RegisterBenchmark(name, [=](benchmark::State& state) { hear(state, keys, is_decoded); });
  };
  add("received", {}, false);
  add("received, seal checked", SwarmKeys(SwarmKeys::fresh()), false);
  add("received, seal checked, decoded", SwarmKeys(SwarmKeys::fresh()), true);
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  swarm::register_all();
  benchmark::RunSpecifiedBenchmarks();
}
