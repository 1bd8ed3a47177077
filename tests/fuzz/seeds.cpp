// Writes the first files of the fuzz targets' corpora, the same ones every time: well-formed inputs of each kind, from
// which mutations go out. Usage: seeds DIRECTORY
#include <octomap/OcTree.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "lcmtypes/bus/lcm_wire.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "lcmtypes/bus/seal.h"
#include "map_daemon/sogm_codec.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/random_messages.h"
#include "tools/bridge/mavlink.h"

namespace swarm::fuzz {
namespace {

constexpr int kElements = 3;  // of a message's array

// The other end of FuzzInput.
class Seed {
 public:
  Seed& word(std::uint64_t value, std::size_t bytes) {
    bytes_.resize(bytes_.size() + bytes);
    write_big_endian(value, std::span(bytes_).last(bytes));
    return *this;
  }
  Seed& byte(std::uint64_t value) { return word(value, 1); }
  Seed& raw(std::span<const std::uint8_t> bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return *this;
  }
  Seed& raw(std::string_view text) { return raw({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}); }
  Seed& part(std::span<const std::uint8_t> bytes) { return word(bytes.size(), 2).raw(bytes); }
  Seed& part(std::string_view text) { return word(text.size(), 2).raw(text); }
  // As message_bytes() reads it: to be mended.
  Seed& message(std::span<const std::uint8_t> bytes) { return byte(1).part(bytes); }
  const Bytes& bytes() const { return bytes_; }

 private:
  Bytes bytes_;
};

class Corpora {
 public:
  explicit Corpora(std::filesystem::path top) : top_(std::move(top)) {}
  void write(const std::string& target, const std::string& name, const Seed& seed) const {
    std::filesystem::create_directories(top_ / target);
    std::ofstream file(top_ / target / name, std::ios::binary);
    file.write(reinterpret_cast<const char*>(seed.bytes().data()), static_cast<std::streamsize>(seed.bytes().size()));
    if (!file.flush()) throw std::runtime_error((top_ / target / name).string() + ": cannot be written");
  }

 private:
  std::filesystem::path top_;
};

template <class T>
Bytes random_message() {
  random_messages::Random random(1);
  Bytes bytes;
  encode(random_messages::make<T>(random, kElements), &bytes);
  return bytes;
}

Bytes message_on(std::string_view channel) {
  Bytes bytes;
  [&]<class... T>(const std::tuple<T...>*) {
    (void)((is_carried_by<T>(channel) && (bytes = random_message<T>(), true)) || ...);
  }(static_cast<AllMessages*>(nullptr));
  return bytes;
}

// Of one robot among so many, and of a keeper that has recorded and expelled it.
void write_cells(const Corpora& corpora, int robots, const sogm_swarm::announcement_t& robot) {
  CellAnnouncement message{robot, {}, {{{0, -1}, {7, true, 4}}, {{1, -1}, {6, false, 9}}}};
  for (int id = 0; id < robots; ++id) message.acks[id] = robot.acks[static_cast<std::size_t>(id)];
  CellRoster roster{{0, -1}, 12, 9, {{robot.header.robot_id, {Membership::kExpelled, 7, 9}}}};
  for (int id = 0; id < robots; ++id) roster.entries[id] = {Membership::kMember, id + 1, id % 9, 3 * id};
  roster.entries.at(robot.header.robot_id).tombstone = robot;
  roster.entries.at(robot.header.robot_id).tombstone->acks.clear();
  const auto write = [&](int kind, const char* name, const auto& packed) {
    const auto utime = static_cast<std::uint64_t>(packed.header.utime);
    const auto boot = static_cast<std::uint64_t>(packed.header.boot);
    corpora.write("packed_cells", std::to_string(robots) + name,
                  Seed().byte(static_cast<std::uint64_t>(kind)).word(utime, 7).word(2 * boot, 4).raw(packed.packed));
  };
  write(0, "_robots", pack(&message).value());
  write(1, "_members", pack(robot.header, &roster).value());
}

void write_wire(const Corpora& corpora) {
  for (std::size_t type = 0; type < std::tuple_size_v<AllMessages>; ++type) {
    with_type(type, [&]<class T>(T) {
      const std::string name = std::string(T::getTypeName());
      corpora.write("messages", name, Seed().byte(type).byte(1).raw(random_message<T>()));
    });
  }
  random_messages::Random random(1);
  for (const int robots : {2, 20}) {
    auto message = random_messages::make<sogm_swarm::announcement_t>(random, robots);
    const auto packed = pack(&message);
    const auto utime = static_cast<std::uint64_t>(packed.header.utime);
    const auto boot = static_cast<std::uint64_t>(packed.header.boot);
    corpora.write("packed", std::to_string(robots) + "_robots",
                  Seed().word(utime, 7).word(2 * boot, 4).raw(packed.packed));
    write_cells(corpora, robots, message);
  }

  const Bytes goal = message_on(channel::kGoal);
  Seed datagrams;
  datagrams.byte(0).byte(1).part("GOAL").byte(1).word(90, 1).part("pattern").word(7, 4);
  datagrams.byte(0).byte(1).part("SOGM").byte(0).word(200'000, 3).part("pattern").word(8, 4);
  corpora.write("lcm_wire", "whole", datagrams);
  Seed raw;
  (void)write_lcm(3, {"GOAL", goal}, [&](auto head, auto bytes) {
    Bytes all(head.begin(), head.end());
    all.insert(all.end(), bytes.begin(), bytes.end());
    raw.byte(1).byte(0).part(all);
    return true;
  });
  corpora.write("lcm_wire", "raw", raw);
  Seed fragments;  // "A", NUL and two bytes; then four more
  fragments.byte(2).byte(1).byte(1).byte(0).byte(6).byte(0).byte(0).byte(0).byte(0).byte(0).byte(2);
  fragments.part(std::string_view("A\0bc", 4));
  fragments.byte(2).byte(1).byte(1).byte(0).byte(6).byte(0).byte(2).byte(0).byte(1).byte(0).byte(2).part("defg");
  corpora.write("lcm_wire", "fragments", fragments);

  const auto event = [](Seed& log, std::string_view channel, const Bytes& bytes) {
    log.word(0xEDA1DA01, 4).word(0, 8).word(1'700'000'000'000'000, 8).word(channel.size(), 4).word(bytes.size(), 4);
    log.raw(channel).raw(bytes);
  };
  Seed log;
  event(log, "GOAL", goal);
  event(log, "X", {1, 2, 3});
  corpora.write("lcm_log", "two_events", log);
  log.raw("garbage").word(0xEDA1DA01, 4);
  event(log, "Y", {});
  corpora.write("lcm_log", "garbage_between", log);

  const std::string key = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n";
  Bytes sealed{1, 2, 3, 4};
  SwarmKeys(key).seal("ANNOUNCEMENT", &sealed);
  corpora.write("seal", "sealed", Seed().byte(1).part("ANNOUNCEMENT").part(std::string_view("\0\1\1", 3)).raw(sealed));
  corpora.write("seal", "key_file", Seed().byte(0).raw("# a key\n\n" + key));
  corpora.write("seal", "two_keys", Seed().byte(0).raw(key + key));
}

void write_texts(const Corpora& corpora) {
  corpora.write("bus_url", "full", Seed().raw("udpm://239.255.76.68:7667?ttl=1&recv_buf_size=2097152"));
  corpora.write("bus_url", "short", Seed().raw("udpm://224.0.0.1:1"));
  corpora.write("options", "config",
                Seed()
                    .part("real = 2.5  # comment\nwhole=7\nduration = 20000\nvector = 1,2,3\n"
                          "list = 1,2,3\ntext = some text\nchecked = yes\nflag = true\n")
                    .raw("--whole=8\n--vector\n4,5,6\nargument\nmore\n"));
  corpora.write("options", "words",
                Seed().part("").raw("--real\n-1e3\n--list=\n--flag=true\n--text=\nargument\n--duration=10000\n"));
  corpora.write("options", "help", Seed().part("").raw("--help\n"));
  corpora.write("world_json", "obstacles", Seed().raw(R"({"name": "w", "space": {"min": [-8,-8,0], "max": [8,8,4]},
"obstacle_bounds": {"min": [-7,-7], "max": [7,7]}, "limits": {"speed": 2.0, "acceleration": 6.0}, "sensing_radius": 5,
"robots": [{"id": 0, "start": [-8,0,1], "goal": [8,0,1], "radius": 0.2}],
"obstacles": [{"shape": "column", "center": [1,2], "diameter": 0.8, "height": 4, "velocity": [0.3,-0.2]},
{"shape": "ring", "center": [0,3,1.2], "radius": 1.0, "width": 0.1, "yaw": 0.4, "velocity": [0.1,0.6], "acceleration": 1},
{"shape": "box", "center": [0,-3,1], "size": [1,0.5,2], "yaw": 0.4},
{"shape": "sphere", "center": [3,-3,1], "diameter": 0.4},
{"shape": "column", "diameter": 0.5, "height": 1.8, "track": [[0,1,2],[0.4,1.3,2]]}]})"));
  corpora.write("world_json", "mission", Seed().raw(R"({"name": "m", "space": {"min": [-9,-9,0], "max": [9,9,4]},
"limits": {"speed": 2, "acceleration": 6}, "robots": [{"id": 3, "start": [-8,0,1], "radius": 0.2,
"limits": {"speed": 1, "acceleration": 3},
"goals": [{"position": [0,0,1], "tolerance": 0.5, "speed": 1.0, "wait": 2.0}, {"position": [8,0,1]}]}],
"obstacles": []})"));
}

void write_maps(const Corpora& corpora) {
  octomap::OcTree tree(0.1);
  for (int i = 0; i < 4; ++i) tree.updateNode(octomap::point3d(0.1f * static_cast<float>(i), 0.25f, 0.5f), true);
  tree.updateNode(octomap::point3d(-1.0f, 0.25f, 0.5f), false);
  std::ostringstream full, binary;
  tree.write(full);
  tree.toMaxLikelihood();
  tree.writeBinary(binary);
  corpora.write("octomap", "full", Seed().word(0, 2).byte(1).raw(full.str()));
  corpora.write("octomap", "binary", Seed().word(0x1000, 2).byte(0).raw(binary.str()));

  Sogm map;
  map.reset({.resolution_m = 0.1, .origin = {-4, -4, 0}, .size = {8, 8, 40}}, 4, to_utime(1'700'000'000'000'000),
            100ms);
  for (int frame = 0; frame < map.num_frames; ++frame) *map.column(frame, 2 + frame, 3) = 0xFFFF;
  sogm_swarm::header_t header{};
  header.schema_version = sogm_swarm::header_t::kSchemaVersion;
  header.robot_id = 1;
  SogmEncoder encoder;
  for (const auto& part : encoder.encode(map, header)) {
    Bytes bytes;
    encode(part, &bytes);
    corpora.write("sogm", "part", Seed().byte(1).message(bytes).byte(1).message(bytes));
  }
}

void write_bridges(const Corpora& corpora) {
  using namespace mavlink;
  Encoder encoder({1, 1});
  Seed stream;
  stream.part("\3\5\7");
  for (const Message& message : {Message(Heartbeat{}), Message(Attitude{1, 2, 3, 4, 5, 6, 7}),
                                 Message(LocalPositionNed{1, {1, 2, 3}, {4, 5, 6}})}) {
    stream.byte(1).part(encoder.encode(message));
    stream.byte(1).part("\xFD\x09 noise \xFE");
  }
  corpora.write("mavlink", "frames", stream);
  corpora.write("mavlink", "made", Seed().part("\1\2").byte(0).byte(1).word(5, 4).byte(0).word(9, 2));
  const std::string datagram =
      R"({"t": 12.34, "bodies": [{"name": "robot1", "position": [1, 2, 3], "quaternion": [1, 0, 0, 0]},)"
      R"({"name": "ring1", "position": [-1, 2, 1], "quaternion": [0.6, 0, 0, 0.8]}]})";
  corpora.write("mocap", "text", Seed().byte(0).byte(3).byte(9).byte(1).byte(1).part(datagram));
  corpora.write("mocap", "rules", Seed().byte(1).part("a*:ring:1,0.1;b:box:1,2,3:0.1,0,0").word(0, 40));
}

// A message of every kind, and what is done with them.
void write_views(const Corpora& corpora) {
  Seed drawings;
  drawings.word(0, 2);
  for (std::size_t i = 0; i < std::size(kChannels); ++i)
    drawings.byte(i).word(50'000, 3).message(message_on(kChannels[i].name));
  corpora.write("drawings", "all", drawings);
  Seed view;
  view.byte(std::size(kChannels) - 1);
  for (std::size_t i = 0; i < std::size(kChannels); ++i)
    view.byte(i).word(50'000, 3).message(message_on(kChannels[i].name));
  view.byte(4).byte(0);  // pause
  for (const std::uint64_t at : {20'000, 60'000, 5'000}) view.byte(6).byte(1).word(at, 2);
  view.byte(1).byte(1).byte(1).byte(2).byte(3).byte(3).byte(1).word(60'000, 2).byte(4).byte(1);
  view.byte(0).part(R"({"goal": {"robot": 1, "waypoints": [{"position": [1, 2, 3], "wait_s": 4}], "times": 5}})");
  view.byte(5).word(2, 2).byte(1).byte(0).word(40'000, 2).byte(0).word(30'000, 2).word(20'000, 2);  // a goal
  view.byte(1).byte(0).word(1, 2).byte(1).word(5, 2).byte(1);                                       // waits, and again
  corpora.write("view", "commands", view);
  corpora.write("web_server", "page", Seed().byte(2).part("/").byte(2).part("/view.js").byte(3).part("localhost:80"));
  corpora.write("web_server", "stream", Seed().byte(7).byte(1).byte(0).part("\x81\x82\1\2\3\4zx"));
  corpora.write("web_server", "post", Seed().byte(4).part("5").part("hello").byte(2).part("/stream"));
}

// What a broadcaster keeps.
void write_promises(const Corpora& corpora) {
  random_messages::Random random(1);
  auto promise = random_messages::make<sogm_swarm::announcement_t>(random, kElements);
  promise.header.robot_id = 1;
  Bytes bytes;
  encode(promise, &bytes);
  const Bytes flight = message_on(channel::kFlightStatus);
  corpora.write("promise", "one", Seed().word(0, 6).word(100, 2).byte(1).message(bytes).message(flight));
  corpora.write("promise", "two",
                Seed().word(0, 6).word(100, 2).byte(2).message(bytes).message(flight).byte(0).part("damaged"));
}

// A broadcaster that commits: it hears its state and both peers, is told twice where to fly, and everybody agrees.
// Flights are of so many pieces.
void write_commits(const Corpora& corpora, const std::string& name, std::uint64_t piece_ms, std::uint64_t pieces) {
  constexpr std::uint64_t kInOrder = 2, kQuiet = 68, kAck = 2;
  Seed seed;
  const auto hear_peers = [&](bool first) {
    for (const std::uint64_t place : {0, 1}) {
      seed.byte(9).byte(place).byte(kQuiet);
      if (first) seed.word(0, 6).word(0, 2).byte(0).byte(0);  // to hover
      seed.byte(kInOrder).byte(kAck);
    }
  };
  const auto pass = [&](std::uint64_t scale, std::uint64_t count) { seed.byte(15).byte(scale).byte(count - 1); };
  seed.byte(1).byte(4).byte(kInOrder).byte(0);
  hear_peers(true);
  pass(2, 20);
  hear_peers(false);
  for (const std::uint64_t there : {0xA000u, 0x6000u}) {
    seed.byte(6)
        .byte(0)
        .byte(2)
        .byte(100)
        .word(there, 2)
        .word(0x8000, 2)
        .word(0x8000, 2)
        .word(piece_ms - 10, 2)
        .byte(pieces - 1)
        .byte(kInOrder);
    pass(2, 10);
    hear_peers(false);
    pass(3, 250);
  }
  corpora.write("broadcast_node", name, seed);
}

// Sequences of whatever these bytes mean.
void write_random(const Corpora& corpora) {
  std::mt19937 random(1);
  for (const char* target :
       {"map_node", "broadcast_node", "planner_node", "bridge_node", "sogm", "mocap", "perception_node"}) {
    for (int number = 0; number < 4; ++number) {
      Seed seed;
      for (int i = 0; i < 150 * (number + 1); ++i) seed.byte(random() % 256);
      corpora.write(target, "random" + std::to_string(number), seed);
    }
  }
}

}  // namespace
}  // namespace swarm::fuzz

int main(int argc, char** argv) {
  using namespace swarm::fuzz;
  if (argc != 2) {
    std::fprintf(stderr, "Usage: %s DIRECTORY\n", argv[0]);
    return 2;
  }
  try {
    const Corpora corpora(argv[1]);
    write_wire(corpora);
    write_texts(corpora);
    write_maps(corpora);
    write_bridges(corpora);
    write_views(corpora);
    write_promises(corpora);
    write_commits(corpora, "commits", 400, 5);
    write_commits(corpora, "leaps_between_knots", 10, 1);
    write_random(corpora);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", argv[0], error.what());
    return 1;
  }
  return 0;
}
