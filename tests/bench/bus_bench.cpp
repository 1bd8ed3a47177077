// bus_bench: processor time that hearing an announcement takes, from the socket to the daemon's message.
#include <benchmark/benchmark.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/node_clock.h"
#include "sogm_swarm/announcement_t.hpp"

namespace swarm {
namespace {

constexpr int kAtOnce = 50;  // fit any receive buffer

// As large as one of a roster of ten, which hover.
std::vector<std::uint8_t> announcement() {
  sogm_swarm::announcement_t message{};
  message.header = HeaderSource(1, 1).next(wall_utime());
  message.radius = 0.2f;
  for (auto* trajectory : {&message.committed, &message.pending}) {
    trajectory->seq = 1;
    trajectory->start_utime = message.header.utime;
    trajectory->piece_us = 200'000;
    trajectory->num_pieces = 10;
  }
  message.pending_state = message.kAnnounced;
  message.num_acks = 10;
  message.acks.assign(10, {-1, 0, 0});
  std::vector<std::uint8_t> bytes;
  encode(message, &bytes);
  return bytes;
}

void hear(benchmark::State& state, const SwarmKeys& keys, bool is_decoded) {
  LcmBus bus("udpm://239.255.76.68:" + std::to_string(20'000 + ::getpid() % 10'000) + "?ttl=0", keys);
  std::int64_t heard = 0;
  sogm_swarm::announcement_t message;
  bus.subscribe(channel::kTrajectory,
                [&](auto, auto bytes) { heard += !is_decoded || decode(bytes, &message) == Refusal::kNone ? 1 : 0; });
  const std::vector<std::uint8_t> bytes = announcement();
  for (auto _ : state) {
    state.PauseTiming();
    for (int i = 0; i < kAtOnce; ++i) (void)bus.publish(channel::kTrajectory, bytes);
    state.ResumeTiming();
    while (bus.drain() > 0) continue;
  }
  state.counters["each"] =
      benchmark::Counter(static_cast<double>(heard), benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  state.counters["bytes"] = static_cast<double>(bytes.size());
}

void register_all() {
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
