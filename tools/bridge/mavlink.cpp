#include "tools/bridge/mavlink.h"

#include <algorithm>
#include <bit>
#include <concepts>
#include <type_traits>

namespace swarm::mavlink {
namespace {

constexpr std::uint8_t kStart = 0xFD, kStartVersion1 = 0xFE;
constexpr std::size_t kHeader = 10, kHeaderVersion1 = 6, kChecksumSize = 2, kSignature = 13, kMaxPayload = 255;
constexpr std::uint8_t kSignedFlag = 1;

struct Definition {
  std::uint32_t id;
  std::uint8_t crc_extra;  // of the message's definition, so that both ends mean the same
  std::uint8_t size;       // of the whole payload
};
// In the order of Message's alternatives.
constexpr Definition kDefinitions[] = {{0, 50, 9},    {30, 39, 28}, {32, 185, 28}, {84, 143, 53}, {82, 49, 39},
                                       {76, 152, 33}, {77, 143, 3}, {245, 130, 2}, {1, 124, 31},  {102, 158, 32}};
static_assert(std::size(kDefinitions) == std::variant_size_v<Message>);

template <class M, class Expected>
concept Is = std::same_as<std::remove_const_t<M>, Expected>;

// Fields as they follow each other on the wire: by size, largest first.
template <Is<Heartbeat> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.custom_mode), a(m.type), a(m.autopilot), a(m.base_mode), a(m.system_status), a(m.mavlink_version);
}
template <Is<Attitude> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.time_boot_ms), a(m.roll), a(m.pitch), a(m.yaw), a(m.roll_rate), a(m.pitch_rate), a(m.yaw_rate);
}
template <Is<LocalPositionNed> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.time_boot_ms), a(m.position), a(m.velocity);
}
template <Is<SetPositionTargetLocalNed> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.time_boot_ms), a(m.position), a(m.velocity), a(m.acceleration), a(m.yaw), a(m.yaw_rate);
  a(m.type_mask), a(m.target_system), a(m.target_component), a(m.frame);
}
template <Is<SetAttitudeTarget> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.time_boot_ms), a(m.turn), a(m.rates), a(m.thrust);
  a(m.target_system), a(m.target_component), a(m.type_mask);
}

template <Is<CommandLong> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.parameters), a(m.command), a(m.target_system), a(m.target_component), a(m.confirmation);
}
template <Is<CommandAck> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.command), a(m.result);
}
template <Is<ExtendedSysState> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.vtol_state), a(m.landed_state);
}
template <Is<SysStatus> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.sensors_present), a(m.sensors_enabled), a(m.sensors_healthy), a(m.load), a(m.voltage_mv), a(m.current_ca);
  a(m.drop_rate), a(m.comm_errors), a(m.errors), a(m.battery_percent);
}
template <Is<VisionPositionEstimate> M, class Archive>
void fields_of(M& m, Archive& a) {
  a(m.time_us), a(m.position), a(m.roll), a(m.pitch), a(m.yaw);
}

// Little-endian.
class Writer {
 public:
  explicit Writer(std::uint8_t* to) : to_(to) {}
  template <class Integer>
  void operator()(Integer value) {
    for (std::size_t i = 0; i < sizeof(value); ++i) *to_++ = static_cast<std::uint8_t>(value >> 8 * i);
  }
  void operator()(float value) { (*this)(std::bit_cast<std::uint32_t>(value)); }
  template <class Value, std::size_t kSize>
  void operator()(const std::array<Value, kSize>& values) {
    for (const Value value : values) (*this)(value);
  }

 private:
  std::uint8_t* to_;
};

class Reader {
 public:
  explicit Reader(const std::uint8_t* from) : from_(from) {}
  template <class Integer>
  void operator()(Integer& value) {
    std::uint64_t all = 0;
    for (std::size_t i = 0; i < sizeof(value); ++i) all |= static_cast<std::uint64_t>(*from_++) << 8 * i;
    value = static_cast<Integer>(all);
  }
  void operator()(float& value) {
    std::uint32_t bits = 0;
    (*this)(bits);
    value = std::bit_cast<float>(bits);
  }
  template <class Value, std::size_t kSize>
  void operator()(std::array<Value, kSize>& values) {
    for (Value& value : values) (*this)(value);
  }

 private:
  const std::uint8_t* from_;
};

// CRC-16/MCRF4XX of the bytes and then of the message's own extra byte.
std::uint16_t checksum(std::span<const std::uint8_t> bytes, std::uint8_t extra) {
  std::uint16_t crc = 0xFFFF;
  const auto add = [&crc](std::uint8_t byte) {
    crc = static_cast<std::uint16_t>(crc ^ byte);
    for (int bit = 0; bit < 8; ++bit) crc = static_cast<std::uint16_t>((crc & 1) != 0 ? crc >> 1 ^ 0x8408 : crc >> 1);
  };
  for (const std::uint8_t byte : bytes) add(byte);
  add(extra);
  return crc;
}

// Of a whole frame but its signature; all between the start byte and the checksum counts.
bool checksum_is_good(std::span<const std::uint8_t> frame, std::uint8_t extra) {
  const std::size_t end = frame.size() - kChecksumSize;
  return checksum(frame.subspan(1, end - 1), extra) == (frame[end] | frame[end + 1] << 8);
}

const Definition* find_definition(std::uint32_t id) {
  const auto* const found = std::ranges::find(kDefinitions, id, &Definition::id);
  return found == std::end(kDefinitions) ? nullptr : found;
}

template <class M>
Message read(const std::uint8_t* payload) {
  M message;
  Reader reader(payload);
  fields_of(message, reader);
  return message;
}

Message decode(const Definition& definition, std::span<const std::uint8_t> payload) {
  std::array<std::uint8_t, kMaxPayload> whole{};  // what was cut off are zeros
  std::ranges::copy(payload, whole.begin());
  switch (&definition - kDefinitions) {
    case 0:
      return read<Heartbeat>(whole.data());
    case 1:
      return read<Attitude>(whole.data());
    case 2:
      return read<LocalPositionNed>(whole.data());
    case 3:
      return read<SetPositionTargetLocalNed>(whole.data());
    case 4:
      return read<SetAttitudeTarget>(whole.data());
    case 5:
      return read<CommandLong>(whole.data());
    case 6:
      return read<CommandAck>(whole.data());
    case 7:
      return read<ExtendedSysState>(whole.data());
    case 8:
      return read<SysStatus>(whole.data());
    default:
      return read<VisionPositionEstimate>(whole.data());
  }
}

}  // namespace

const char* to_string(Skipped reason) {
  switch (reason) {
    case Skipped::kNoise:
      return "noise";
    case Skipped::kMavlink1:
      return "MAVLink 1";
    case Skipped::kFlags:
      return "incompatible flags";
    case Skipped::kOther:
      return "other messages";
    case Skipped::kChecksum:
      return "checksum";
    case Skipped::kSystem:
      return "system id";
    case Skipped::kComponent:
      return "component id";
  }
  return "?";
}

std::span<const std::uint8_t> Encoder::encode(const Message& message) {
  const Definition& definition = kDefinitions[message.index()];
  std::uint8_t* const payload = frame_.data() + kHeader;
  std::visit(
      [payload](const auto& m) {
        Writer writer(payload);
        fields_of(m, writer);
      },
      message);
  std::size_t length = definition.size;
  while (length > 1 && payload[length - 1] == 0) --length;  // trailing zeros are not sent
  Writer header(frame_.data());
  header(kStart);
  header(static_cast<std::uint8_t>(length));
  header(std::uint16_t{0});  // no flags
  header(sequence_++);
  header(self_.system);
  header(self_.component);
  header(static_cast<std::uint16_t>(definition.id));  // three bytes, all ids here fit two
  header(static_cast<std::uint8_t>(definition.id >> 16));
  const std::size_t end = kHeader + length;
  Writer(payload + length)(checksum(std::span(frame_).subspan(1, end - 1), definition.crc_extra));
  return std::span(frame_).first(end + kChecksumSize);
}

void Parser::feed(std::span<const std::uint8_t> bytes, const Taker& take) {
  while (!bytes.empty()) {
    const std::size_t room = std::min(bytes.size(), pending_.size() - num_pending_);
    std::ranges::copy(bytes.first(room), pending_.begin() + static_cast<std::ptrdiff_t>(num_pending_));
    num_pending_ += room;
    bytes = bytes.subspan(room);
    std::size_t done = 0;
    while (done < num_pending_) {
      const std::size_t more = parse(std::span(pending_).subspan(done, num_pending_ - done), take);
      if (more == 0) break;
      done += more;
    }
    std::copy(pending_.begin() + static_cast<std::ptrdiff_t>(done),
              pending_.begin() + static_cast<std::ptrdiff_t>(num_pending_), pending_.begin());
    num_pending_ -= done;
  }
}

std::size_t Parser::parse(std::span<const std::uint8_t> bytes, const Taker& take) {
  if (bytes[0] == kStartVersion1) return parse_version_1(bytes);
  if (bytes[0] != kStart) return pass_over();
  if (bytes.size() < 3) return 0;
  const std::size_t length = bytes[1], size = kHeader + length + kChecksumSize;
  if (const std::uint8_t flags = bytes[2]; flags != 0)
    return pass_over(Skipped::kFlags, size - 1 + (flags == kSignedFlag ? kSignature : 0));
  if (bytes.size() < kHeader) return 0;
  const std::uint32_t id = bytes[7] | bytes[8] << 8 | bytes[9] << 16;
  const Definition* const definition = find_definition(id);
  if (definition == nullptr) return pass_over(Skipped::kOther, size - 1);
  if (bytes.size() < size) return 0;
  if (!checksum_is_good(bytes.first(size), definition->crc_extra)) return pass_over(Skipped::kChecksum, 0);
  if (is_expected({bytes[5], bytes[6]})) {
    ++frames_;
    take(decode(*definition, bytes.subspan(kHeader, length)));
  }
  return finish(size);
}

// Only to tell that somebody speaks it.
std::size_t Parser::parse_version_1(std::span<const std::uint8_t> bytes) {
  if (bytes.size() < kHeaderVersion1) return 0;
  const Definition* const definition = find_definition(bytes[5]);
  if (definition == nullptr || bytes[1] != definition->size) return pass_over();
  const std::size_t size = kHeaderVersion1 + definition->size + kChecksumSize;
  if (bytes.size() < size) return 0;
  if (!checksum_is_good(bytes.first(size), definition->crc_extra)) return pass_over();
  if (is_expected({bytes[3], bytes[4]})) count(Skipped::kMavlink1);
  return finish(size);
}

std::size_t Parser::pass_over() {
  if (foreign_ > 0)
    --foreign_;
  else
    count(Skipped::kNoise);
  return 1;
}

// Inside what seems to be another's frame nothing is counted: it is chance there.
std::size_t Parser::pass_over(Skipped reason, std::size_t more) {
  if (foreign_ > 0) return pass_over();
  count(reason);
  foreign_ = more;
  return 1;
}

std::size_t Parser::finish(std::size_t size) {
  foreign_ = 0;
  return size;
}

bool Parser::is_expected(Sender sender) {
  if (sender.system != from_.system) {
    count(Skipped::kSystem);
    return false;
  }
  if (from_.component != 0 && sender.component != from_.component) {
    count(Skipped::kComponent);
    return false;
  }
  return true;
}

}  // namespace swarm::mavlink
