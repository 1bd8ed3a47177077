// The MAVLink parser: however a stream is cut into pieces, its messages and counters are the same; a message that is
// encoded comes back as it was; and no garbage hides a good frame.
#include "tools/bridge/mavlink.h"

#include <numeric>
#include <optional>

#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {
namespace {

using namespace mavlink;

constexpr Sender kSender{1, 1};

// The frames that these messages make: equal when all fields are, bit by bit.
class Log {
 public:
  void take(const Message& message) {
    const auto frame = encoder_.encode(message);
    frames.emplace_back(frame.begin(), frame.end());
  }
  std::vector<Bytes> frames;

 private:
  Encoder encoder_{kSender};
};

struct Reading {
  Parser parser{kSender};
  Log log;
  void feed(std::span<const std::uint8_t> bytes) {
    const Bytes copy(bytes.begin(), bytes.end());
    parser.feed(copy, [this](const Message& message) { log.take(message); });
  }
  bool operator==(const Reading& other) const {
    for (int reason = 0; reason < kNumSkipped; ++reason) {
      if (parser.skipped(static_cast<Skipped>(reason)) != other.parser.skipped(static_cast<Skipped>(reason)))
        return false;
    }
    return parser.frames() == other.parser.frames() && log.frames == other.log.frames;
  }
};

Message make_message(FuzzInput& input) {
  const auto number = [&] { return static_cast<float>(input.flag() ? input.any_real() : input.real(-100, 100)); };
  switch (input.byte() % 10) {
    case 0:
      return Heartbeat{static_cast<std::uint32_t>(input.word(4)),
                       input.byte(),
                       input.byte(),
                       input.byte(),
                       input.byte(),
                       input.byte()};
    case 1:
      return Attitude{
          static_cast<std::uint32_t>(input.word(4)), number(), number(), number(), number(), number(), number()};
    case 2:
      return LocalPositionNed{
          static_cast<std::uint32_t>(input.word(4)), {number(), number(), number()}, {number(), number(), number()}};
    case 3: {
      SetAttitudeTarget target;
      target.time_boot_ms = static_cast<std::uint32_t>(input.word(4));
      target.turn = {number(), number(), number(), number()};
      target.rates = {number(), number(), number()};
      target.thrust = number();
      target.type_mask = input.byte();
      return target;
    }
    case 4: {
      SetPositionTargetLocalNed target;
      target.time_boot_ms = static_cast<std::uint32_t>(input.word(4));
      for (auto* values : {&target.position, &target.velocity, &target.acceleration})
        *values = {number(), number(), number()};
      target.yaw = number();
      target.type_mask = static_cast<std::uint16_t>(input.word(2));
      target.frame = input.byte();
      return target;
    }
    case 5: {
      CommandLong command;
      command.parameters = {number(), number(), number(), number(), number(), number(), number()};
      command.command = static_cast<std::uint16_t>(input.word(2));
      return command;
    }
    case 6:
      return CommandAck{static_cast<std::uint16_t>(input.word(2)), input.byte()};
    case 7:
      return ExtendedSysState{input.byte(), input.byte()};
    case 8:
      return VisionPositionEstimate{input.word(8), {number(), number(), number()}, number(), number(), number()};
    default: {
      SysStatus status;
      status.sensors_healthy = static_cast<std::uint32_t>(input.word(4));
      status.errors[3] = static_cast<std::uint16_t>(input.word(2));
      status.battery_percent = input.byte();
      return status;
    }
  }
}

}  // namespace

void try_input(FuzzInput input) {
  // The pieces that the stream comes in, then messages, then garbage between them.
  const auto pieces = input.part();
  std::vector<Bytes> stream;
  Encoder encoder(kSender);
  std::optional<Bytes> newest;
  while (!input.empty()) {
    if (input.flag()) {
      const auto part = input.part();
      stream.emplace_back(part.begin(), part.end());
    } else {
      const auto frame = encoder.encode(make_message(input));
      stream.emplace_back(frame.begin(), frame.end());
      newest = stream.back();
    }
  }
  Bytes all;
  for (const auto& part : stream) all.insert(all.end(), part.begin(), part.end());

  Reading whole, byte_by_byte, in_pieces;
  whole.feed(all);
  for (const std::uint8_t& byte : all) byte_by_byte.feed({&byte, 1});
  std::size_t at = 0;
  for (const std::uint8_t piece : pieces) {
    const std::size_t end = std::min(at + piece, all.size());
    in_pieces.feed(std::span(all).subspan(at, end - at));
    at = end;
  }
  in_pieces.feed(std::span(all).subspan(at));
  expect(whole == byte_by_byte && whole == in_pieces, "pieces change nothing");

  // A frame behind it all is found, unless by chance it is inside another one whose checksum is good.
  const std::int64_t frames = whole.parser.frames();
  const auto good = encoder.encode(Attitude{1, 2, 3, 4, 5, 6, 7});
  Bytes behind(good.begin(), good.end());
  behind.resize(behind.size() + 2 * kMaxFrame);
  whole.feed(behind);
  Log wanted;
  wanted.take(Attitude{1, 2, 3, 4, 5, 6, 7});
  const auto same = [&](const Bytes& frame) {  // but for its number
    return frame.size() == wanted.frames[0].size() &&
           std::equal(frame.begin() + 10, frame.end() - 2, wanted.frames[0].begin() + 10);
  };
  std::int64_t others = whole.parser.frames() - frames;
  for (const Skipped reason : {Skipped::kMavlink1, Skipped::kSystem, Skipped::kComponent})
    others += whole.parser.skipped(reason);
  expect(others > 0 && (others > 1 || std::ranges::any_of(whole.log.frames, same)), "no garbage hides a good frame");
}

}  // namespace swarm::fuzz
