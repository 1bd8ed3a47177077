// Frames on the wire against vectors of another implementation, and the parser against whatever a line may carry.
#include "tools/bridge/mavlink.h"

#include <bit>

#include "tests/support/harness.h"
#include "tests/support/random_motion.h"

namespace swarm::mavlink {
namespace {

using test::Bytes;

constexpr Sender kController{34, 1};

Bytes from_hex(std::string_view hex) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(std::string(hex.substr(i, 2)), nullptr, 16)));
  return bytes;
}

// All fields as bits: NaN is as good as any.
std::vector<std::uint32_t> fields(const Message& message) {
  std::vector<std::uint32_t> all = {static_cast<std::uint32_t>(message.index())};
  const auto add = [&all](const auto&... values) { (all.push_back(static_cast<std::uint32_t>(values)), ...); };
  const auto add_float = [&all](float value) { all.push_back(std::bit_cast<std::uint32_t>(value)); };
  const auto add_all = [&](const auto& values) { std::ranges::for_each(values, add_float); };
  if (const auto* const m = std::get_if<Heartbeat>(&message))
    add(m->custom_mode, m->type, m->autopilot, m->base_mode, m->system_status, m->mavlink_version);
  if (const auto* const m = std::get_if<Attitude>(&message)) {
    add(m->time_boot_ms);
    add_all(std::array{m->roll, m->pitch, m->yaw, m->roll_rate, m->pitch_rate, m->yaw_rate});
  }
  if (const auto* const m = std::get_if<LocalPositionNed>(&message)) {
    add(m->time_boot_ms);
    for (const auto& values : {m->position, m->velocity}) add_all(values);
  }
  if (const auto* const m = std::get_if<SetPositionTargetLocalNed>(&message)) {
    add(m->time_boot_ms, m->type_mask, m->target_system, m->target_component, m->frame);
    for (const auto& values : {m->position, m->velocity, m->acceleration}) add_all(values);
    add_all(std::array{m->yaw, m->yaw_rate});
  }
  if (const auto* const m = std::get_if<SetAttitudeTarget>(&message)) {
    add(m->time_boot_ms, m->target_system, m->target_component, m->type_mask);
    add_all(m->turn), add_all(m->rates), add_float(m->thrust);
  }
  if (const auto* const m = std::get_if<CommandLong>(&message)) {
    add(m->command, m->target_system, m->target_component, m->confirmation);
    add_all(m->parameters);
  }
  if (const auto* const m = std::get_if<CommandAck>(&message)) add(m->command, m->result);
  if (const auto* const m = std::get_if<ExtendedSysState>(&message)) add(m->vtol_state, m->landed_state);
  if (const auto* const m = std::get_if<SysStatus>(&message)) {
    add(m->sensors_present, m->sensors_enabled, m->sensors_healthy, m->load, m->voltage_mv, m->current_ca);
    add(m->drop_rate, m->comm_errors, m->battery_percent);
    for (const std::uint16_t count : m->errors) add(count);
  }
  if (const auto* const m = std::get_if<VisionPositionEstimate>(&message)) {
    add(m->time_us, m->time_us >> 32);
    add_all(m->position), add_all(std::array{m->roll, m->pitch, m->yaw});
  }
  return all;
}

Message random_message(Rng& rng) {
  const auto number = [&] { return uniform_int(rng, 0, 2) == 0 ? 0u : static_cast<std::uint32_t>(rng()); };
  const auto byte = [&] { return static_cast<std::uint8_t>(number()); };
  const auto real = [&] { return std::bit_cast<float>(number()); };
  const auto vector = [&] { return std::array{real(), real(), real()}; };
  const auto word = [&] { return static_cast<std::uint16_t>(number()); };
  switch (uniform_int(rng, 0, 9)) {
    case 0: {
      Heartbeat m;
      m.custom_mode = number();
      m.type = byte(), m.autopilot = byte(), m.base_mode = byte(), m.system_status = byte();
      return m;
    }
    case 1:
      return Attitude{number(), real(), real(), real(), real(), real(), real()};
    case 2:
      return LocalPositionNed{number(), vector(), vector()};
    case 3: {
      SetAttitudeTarget m;
      m.time_boot_ms = number();
      m.turn = {real(), real(), real(), real()};
      m.rates = vector(), m.thrust = real();
      m.target_system = byte(), m.target_component = byte(), m.type_mask = byte();
      return m;
    }
    case 4: {
      CommandLong m;
      m.parameters = {real(), real(), real(), real(), real(), real(), real()};
      m.command = word(), m.target_system = byte(), m.target_component = byte(), m.confirmation = byte();
      return m;
    }
    case 5:
      return CommandAck{word(), byte()};
    case 6:
      return ExtendedSysState{byte(), byte()};
    case 7: {
      SysStatus m;
      m.sensors_present = number(), m.sensors_enabled = number(), m.sensors_healthy = number();
      m.load = word(), m.voltage_mv = word(), m.current_ca = word(), m.drop_rate = word(), m.comm_errors = word();
      m.errors = {word(), word(), word(), word()};
      m.battery_percent = byte();
      return m;
    }
    case 8:
      return VisionPositionEstimate{number() | std::uint64_t{number()} << 32, vector(), real(), real(), real()};
    default: {
      SetPositionTargetLocalNed m;
      m.time_boot_ms = number();
      m.position = vector(), m.velocity = vector(), m.acceleration = vector();
      m.yaw = real(), m.yaw_rate = real();
      m.type_mask = static_cast<std::uint16_t>(number());
      m.target_system = byte(), m.target_component = byte(), m.frame = byte();
      return m;
    }
  }
}

Bytes frame_of(Encoder& encoder, const Message& message) {
  const std::span<const std::uint8_t> frame = encoder.encode(message);
  return {frame.begin(), frame.end()};
}

// A parser and what it has found.
struct Receiver {
  explicit Receiver(Sender from = kController) : parser(from) {}
  void feed(std::span<const std::uint8_t> bytes) {
    parser.feed(bytes, [this](const Message& message) { found.push_back(message); });
  }
  std::int64_t skipped_in_all() const {
    std::int64_t sum = 0;
    for (int i = 0; i < kNumSkipped; ++i) sum += parser.skipped(static_cast<Skipped>(i));
    return sum;
  }
  Parser parser;
  std::vector<Message> found;
};

// A frame of any kind, checksum included.
Bytes raw_frame(std::uint32_t id, const Bytes& payload, std::uint8_t extra, std::uint8_t flags = 0,
                Sender from = kController) {
  Bytes bytes = {0xFD,
                 static_cast<std::uint8_t>(payload.size()),
                 flags,
                 0,
                 0,
                 from.system,
                 from.component,
                 static_cast<std::uint8_t>(id),
                 static_cast<std::uint8_t>(id >> 8),
                 static_cast<std::uint8_t>(id >> 16)};
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  std::uint32_t crc = 0xFFFF;
  const auto add = [&crc](std::uint8_t byte) {  // the protocol's own formula, unlike the encoder's bit by bit
    const auto mixed = static_cast<std::uint8_t>(byte ^ crc), folded = static_cast<std::uint8_t>(mixed ^ mixed << 4);
    crc = (crc >> 8 ^ static_cast<std::uint32_t>(folded) << 8 ^ static_cast<std::uint32_t>(folded) << 3 ^ folded >> 4) &
          0xFFFF;
  };
  std::for_each(bytes.begin() + 1, bytes.end(), add);
  add(extra);
  bytes.push_back(static_cast<std::uint8_t>(crc));
  bytes.push_back(static_cast<std::uint8_t>(crc >> 8));
  if ((flags & 1) != 0) bytes.insert(bytes.end(), 13, 0xFD);  // a signature
  return bytes;
}

// CacheKey by another implementation (node-mavlink 2.3.0).
TEST(Mavlink, AgreesWithAnotherImplementation) {
  struct Vector {
    Sender sender;
    std::uint8_t sequence;
    std::vector<std::uint32_t> fields;  // as above
    const char* hex;
  };
  const Vector vectors[] = {
      {{191, 247}, 18, {0u, 71076620u, 0u, 28u, 0u, 152u, 10u}, "fd09000012bff70000000c8b3c04001c00980a8bc3"},
      {{169, 159},
       41,
       {1u, 1976919423u, 4092132961u, 0u, 3244072263u, 30373489u, 4132897781u, 1072676184u},
       "fd1c000029a99f1e00007f65d57561fee8f300000000479d5cc17176cf01f50357f658bdef3fe499"},
      {{186, 137},
       63,
       {2u, 0u, 1091049841u, 1088159131u, 0u, 613592935u, 3406547950u, 1735450594u},
       "fd1c00003fba8920000000000000711908419bfddb400000000067af9224eecb0bcbe2df7067cec7"},
      {{89, 250},
       197,
       {3u, 3736653878u, 60946u, 0u, 185u, 107u, 1098719636u, 3364016966u, 2624265408u, 395331268u, 1617571339u,
        1091265850u, 2402694816u, 880717258u, 15902843u, 469402329u, 0u},
       "fd350000c559fa54000036d0b8de94217d4146d382c8c01c6b9cc44690170b2e6a603a650b41a036368fcaad7e347ba8f200d982fa1b000"
       "0000012ee00b96bd2c4"},
      {{115, 217}, 36, {0u, 1932229303u, 95u, 0u, 98u, 160u, 0u}, "fd0800002473d9000000b77a2b735f0062a0186e"},
      {{98, 173},
       185,
       {1u, 0u, 2741269411u, 1549116011u, 790336550u, 1099228830u, 3244445587u, 1420728128u},
       "fd1c0000b962ad1e000000000000a37364a36ba2555c26941b2f9ee68441934f62c14097ae54a804"},
      {{183, 187},
       218,
       {2u, 0u, 544629845u, 1065813604u, 3194298564u, 3230828202u, 2538498598u, 0u},
       "fd180000dab7bb20000000000000556476206406873fc42065beaa8692c0266a4e976dc3"},
      {{156, 237},
       26,
       {3u, 1802200254u, 58503u, 221u, 0u, 223u, 2293824729u, 1392619379u, 1085630139u, 1986188769u, 3245946528u,
        1092931649u, 2429908896u, 1078043874u, 0u, 3232041055u, 872936073u},
       "fd3500001a9ced540000be646b6bd9fcb88873af0153bb66b540e1d56276a03679c141d02441a077d590e2a44140000000005f08a5c089f"
       "2073487e4dd00dff898"},
      {{5, 4},
       243,
       {4u, 2332836374u, 101u, 245u, 103u, 1090729374u, 0u, 1064799180u, 1085630596u, 0u, 1091899162u, 0u, 3209382712u},
       "fd270000f3050452000016420c8b9e35034100000000cc8b773f8468b540000000001a0f154100000000384b4bbf65f567c02c"},
      {{254, 169},
       77,
       {4u, 1816322682u, 3u, 199u, 0u, 3230147383u, 1080060018u, 0u, 0u, 3228644137u, 0u, 3229963130u, 1091825079u},
       "fd2600004dfea95200007ae2426c372388c0726860400000000000000000293371c0000000007a5385c0b7ed134103c7edca"},
  };
  for (const Vector& vector : vectors) {
    SCOPED_TRACE(vector.hex);
    Receiver receiver(vector.sender);
    receiver.feed(from_hex(vector.hex));
    ASSERT_EQ(receiver.found.size(), 1u);
    EXPECT_EQ(receiver.skipped_in_all(), 0);
    EXPECT_EQ(fields(receiver.found[0]), vector.fields);
    Encoder encoder(vector.sender);
    for (int i = 0; i < vector.sequence; ++i) (void)encoder.encode(Heartbeat());
    EXPECT_EQ(frame_of(encoder, receiver.found[0]), from_hex(vector.hex));
  }
}

// Its extra byte and bytes worked out from the message's definition, in Python.
TEST(Mavlink, TellsWhereOthersSeeTheVehicle) {
  Encoder encoder(kController);
  for (int i = 0; i < 7; ++i) (void)encoder.encode(Heartbeat());
  const VisionPositionEstimate estimate{1764259200123456, {1.5f, -2.25f, -3.0f}, 0.125f, -0.0625f, 0.5f};
  EXPECT_EQ(frame_of(encoder, estimate),
            from_hex("fd2000000722016600004042ea9a954406000000c03f000010c0000040c00000003e000080bd0000003f9773"));
}

TEST(Mavlink, RandomMessagesComeThroughInAnyPieces) {
  Rng rng(1);
  Encoder encoder(kController);
  for (int round = 0; round < 200; ++round) {
    Bytes stream;
    std::vector<Message> sent;
    for (int i = 0; i < 20; ++i) {
      sent.push_back(random_message(rng));
      const Bytes frame = frame_of(encoder, sent.back());
      stream.insert(stream.end(), frame.begin(), frame.end());
    }
    Receiver receiver;
    for (std::size_t begin = 0; begin < stream.size();) {
      const int most = round % 3 == 0 ? 1 : round % 3 == 1 ? 40 : 1000;
      const std::size_t size = std::min(stream.size() - begin, static_cast<std::size_t>(uniform_int(rng, 1, most)));
      receiver.feed(Bytes(stream.begin() + static_cast<std::ptrdiff_t>(begin),  // of its own, to see reads beyond
                          stream.begin() + static_cast<std::ptrdiff_t>(begin + size)));
      begin += size;
    }
    ASSERT_EQ(receiver.found.size(), sent.size()) << "round " << round;
    for (std::size_t i = 0; i < sent.size(); ++i) ASSERT_EQ(fields(receiver.found[i]), fields(sent[i])) << round;
    EXPECT_EQ(receiver.skipped_in_all(), 0);
    EXPECT_EQ(receiver.parser.frames(), 20);
  }
}

TEST(Mavlink, EveryWrongByteIsNoticed) {
  Rng rng(2);
  Encoder encoder(kController);
  for (int round = 0; round < 12; ++round) {
    const Bytes good = frame_of(encoder, random_message(rng)), next = frame_of(encoder, Attitude{1, 2, 3, 4, 5, 6, 7});
    for (std::size_t at = 0; at < good.size(); ++at) {
      for (int wrong = 1; wrong < 256; ++wrong) {
        Bytes stream = good;
        stream[at] = static_cast<std::uint8_t>(stream[at] ^ wrong);
        // What comes after it is found: at once or, where the length is wrong, with the frames that follow.
        for (int i = 0; i < 12; ++i) stream.insert(stream.end(), next.begin(), next.end());
        Receiver receiver;
        receiver.feed(stream);
        ASSERT_EQ(receiver.found.size(), 12u) << "round " << round << ", byte " << at << " ^ " << wrong;
        for (const Message& message : receiver.found) ASSERT_EQ(message.index(), 1u);
        ASSERT_GT(receiver.skipped_in_all(), 0);
      }
    }
  }
}

TEST(Mavlink, CountsWhatItPassesOverByReason) {
  Encoder mine(kController), other_system({35, 1}), other_part({34, 154});
  const Bytes good = frame_of(mine, LocalPositionNed{1000, {1, 2, 3}, {4, 5, 6}});
  Bytes damaged = good;
  damaged[12] ^= 1;
  const std::pair<Skipped, Bytes> cases[] = {
      {Skipped::kNoise, {0x00}},
      {Skipped::kFlags, raw_frame(32, Bytes(28, 1), 185, 1)},
      {Skipped::kFlags, raw_frame(32, Bytes(28, 1), 185, 4)},
      {Skipped::kOther, raw_frame(105, Bytes(63, 0xFD), 93)},
      {Skipped::kOther, raw_frame(0x10020, Bytes(28, 1), 185)},  // 32 in its lower two bytes
      {Skipped::kChecksum, damaged},
      {Skipped::kSystem, frame_of(other_system, Attitude{})},
      {Skipped::kComponent, frame_of(other_part, Heartbeat{})},
  };
  for (const auto& [reason, bytes] : cases) {
    SCOPED_TRACE(to_string(reason));
    Receiver receiver;
    receiver.feed(good);
    receiver.feed(bytes);
    receiver.feed(good);
    EXPECT_EQ(receiver.found.size(), 2u);
    EXPECT_EQ(receiver.parser.skipped(reason), 1);
    // Of a damaged frame all other bytes are noise; nothing else is counted twice.
    const std::int64_t noise = reason == Skipped::kChecksum ? static_cast<std::int64_t>(damaged.size()) - 1 : 0;
    EXPECT_EQ(receiver.skipped_in_all(), 1 + noise);
  }
  Receiver any({34, 0});
  any.feed(frame_of(other_part, Heartbeat{}));
  EXPECT_EQ(any.found.size(), 1u);
}

// A heartbeat in protocol version 1.
TEST(Mavlink, PassesOverVersion1) {
  Receiver receiver;
  const Bytes version_1 = from_hex("fe090922010000000600020c9d0403032c");
  receiver.feed(version_1);
  EXPECT_TRUE(receiver.found.empty());
  EXPECT_EQ(receiver.parser.skipped(Skipped::kMavlink1), 1);
  EXPECT_EQ(receiver.skipped_in_all(), 1);
  Receiver other({35, 1});
  other.feed(version_1);
  EXPECT_EQ(other.parser.skipped(Skipped::kMavlink1), 0);
  EXPECT_EQ(other.parser.skipped(Skipped::kSystem), 1);
}

TEST(Mavlink, ShortPayloadsEndInZerosAndExtensionsAreCutOff) {
  const Bytes payload = {1, 0, 0, 0, 0, 0, 0x80, 0x3F};
  Receiver receiver;
  receiver.feed(raw_frame(32, payload, 185));
  Bytes extended(28, 0);
  std::copy(payload.begin(), payload.end(), extended.begin());
  extended.insert(extended.end(), 20, 7);
  receiver.feed(raw_frame(32, extended, 185));
  receiver.feed(raw_frame(32, {}, 185));
  receiver.feed(raw_frame(32, Bytes(255, 0), 185));
  ASSERT_EQ(receiver.found.size(), 4u);
  const LocalPositionNed whole{1, {1, 0, 0}, {0, 0, 0}};
  EXPECT_EQ(fields(receiver.found[0]), fields(whole));
  EXPECT_EQ(fields(receiver.found[1]), fields(whole));
  EXPECT_EQ(fields(receiver.found[2]), fields(LocalPositionNed{}));
  EXPECT_EQ(fields(receiver.found[3]), fields(LocalPositionNed{}));

  Encoder encoder(kController);
  EXPECT_EQ(encoder.encode(LocalPositionNed{}).size(), 13u);  // one byte of payload is always there
  EXPECT_EQ(encoder.encode(whole).size(), 12 + payload.size());
}

// Random bytes, thick with what begins a frame, between good frames: all good ones are found.
TEST(Mavlink, FindsGoodFramesInAnyNoise) {
  Rng rng(3);
  std::int64_t frames = 0, noise = 0;
  for (int round = 0; round < 300; ++round) {
    Encoder encoder(kController);
    Receiver receiver;
    std::vector<Message> sent;
    for (int i = 0; i < 20; ++i) {
      Bytes garbage(static_cast<std::size_t>(uniform_int(rng, 0, 300)));
      for (std::uint8_t& byte : garbage) {
        const std::uint8_t starts[] = {0xFD, 0xFE, 0, 30, 32, 84, 28};
        byte = uniform_int(rng, 0, 2) == 0 ? starts[uniform_int(rng, 0, 6)] : static_cast<std::uint8_t>(rng());
      }
      if (i % 5 == 0) garbage.insert(garbage.end(), {0xFD, 255, 0, 0, 0, 34, 1, 32, 0, 0});  // one that never ends
      receiver.feed(garbage);
      noise += static_cast<std::int64_t>(garbage.size());
      sent.push_back(random_message(rng));
      receiver.feed(frame_of(encoder, sent.back()));
    }
    receiver.feed(Bytes(kMaxFrame, 0));
    ASSERT_EQ(receiver.found.size(), sent.size()) << "round " << round;
    for (std::size_t i = 0; i < sent.size(); ++i) ASSERT_EQ(fields(receiver.found[i]), fields(sent[i])) << round;
    frames += receiver.parser.frames();
  }
  EXPECT_EQ(frames, 6000);
  EXPECT_GT(noise, 100'000);
}

TEST(Mavlink, NoiseAloneIsNoMessage) {
  Rng rng(4);
  Receiver receiver;
  for (int i = 0; i < 2000; ++i) {
    Bytes garbage(1000);
    for (std::uint8_t& byte : garbage) byte = static_cast<std::uint8_t>(rng());
    receiver.feed(garbage);
  }
  EXPECT_TRUE(receiver.found.empty());
  EXPECT_GT(receiver.parser.skipped(Skipped::kNoise), 1'000'000);
  EXPECT_GT(receiver.parser.skipped(Skipped::kFlags), 0);
}

}  // namespace
}  // namespace swarm::mavlink
