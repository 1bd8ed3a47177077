// The part of MAVLink 2 that leads a flight controller from the ground to the ground: ten messages, their frames on
// the wire, and a parser that takes any bytes in any pieces (https://mavlink.io/en/guide/serialization.html; message
// set "common"). Frames are not signed.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <variant>

namespace swarm::mavlink {

// Somebody is there. Ids and bits as the message set numbers them.
struct Heartbeat {
  static constexpr std::uint8_t kOnboardController = 18;               // type
  static constexpr std::uint8_t kArdupilot = 3, kNone = 8, kPx4 = 12;  // autopilot
  static constexpr std::uint8_t kArmed = 128;                          // bit of base_mode
  static constexpr std::uint8_t kActive = 4;                           // system_status

  std::uint32_t custom_mode = 0;  // the autopilot's own number of its flight mode
  std::uint8_t type = 0, autopilot = 0, base_mode = 0, system_status = 0, mavlink_version = 3;
};

// Turn of the body against north, east, down [rad] and its rates about the body's axes [rad/s].
struct Attitude {
  std::uint32_t time_boot_ms = 0;  // since the sender's start [ms]
  float roll = 0, pitch = 0, yaw = 0, roll_rate = 0, pitch_rate = 0, yaw_rate = 0;
};

// Position [m] and velocity [m/s], north, east, down of the autopilot's local origin.
struct LocalPositionNed {
  std::uint32_t time_boot_ms = 0;
  std::array<float, 3> position{}, velocity{};
};

// Where to be and how to move: north, east, down [m], [m/s], [m/s^2]; yaw clockwise from north [rad], [rad/s].
struct SetPositionTargetLocalNed {
  static constexpr std::uint8_t kLocalNed = 1;  // frame

  std::uint32_t time_boot_ms = 0;
  std::array<float, 3> position{}, velocity{}, acceleration{};
  float yaw = 0, yaw_rate = 0;
  std::uint16_t type_mask = 0;  // what is to be ignored; 0: nothing
  std::uint8_t target_system = 0, target_component = 0, frame = kLocalNed;
};

// How to stand in the air and how hard to push.
struct SetAttitudeTarget {
  std::uint32_t time_boot_ms = 0;
  std::array<float, 4> turn = {1, 0, 0,
                               0};  // quaternion w, x, y, z: the body (forward, right, down) in north, east, down
  std::array<float, 3> rates{};     // about the body's axes [rad/s]
  float thrust = 0;                 // share of the most there is
  std::uint8_t target_system = 0, target_component = 0;
  std::uint8_t type_mask = 0;  // what is to be ignored; 0: nothing
};

// Do this now: `command` as the message set numbers them.
struct CommandLong {
  static constexpr std::uint16_t kTakeOff = 22;  // parameter 7: height over the ground [m]
  static constexpr std::uint16_t kSetMode =
      176;  // 1: that the mode is the autopilot's own, 2: its number, 3: PX4's submode
  static constexpr std::uint16_t kArm = 400;  // 1: 1 arms, 0 disarms

  std::array<float, 7> parameters{};
  std::uint16_t command = 0;
  std::uint8_t target_system = 0, target_component = 0, confirmation = 0;
};

// What became of a command: 0 it was accepted, 5 it is on its way; all else it was not.
struct CommandAck {
  static constexpr std::uint8_t kAccepted = 0, kInProgress = 5;

  std::uint16_t command = 0;
  std::uint8_t result = 0;
};

// Where the vehicle stands.
struct ExtendedSysState {
  static constexpr std::uint8_t kOnGround = 1, kInAir = 2, kTakeOff = 3, kLanding = 4;

  std::uint8_t vtol_state = 0, landed_state = 0;
};

// How the autopilot is.
struct SysStatus {
  std::uint32_t sensors_present = 0, sensors_enabled = 0, sensors_healthy = 0;
  std::uint16_t load = 0, voltage_mv = 0;
  std::uint16_t current_ca = 0;  // two's complement [10 mA]
  std::uint16_t drop_rate = 0, comm_errors = 0;
  std::array<std::uint16_t, 4> errors{};
  std::uint8_t battery_percent = 0xFF;  // what is left; above 100: not known
};

// Where the vehicle is by the eyes of somebody else: north, east, down of the autopilot's local origin [m], and its
// turn as in Attitude.
struct VisionPositionEstimate {
  std::uint64_t time_us = 0;  // since the epoch
  std::array<float, 3> position{};
  float roll = 0, pitch = 0, yaw = 0;
};

using Message = std::variant<Heartbeat, Attitude, LocalPositionNed, SetPositionTargetLocalNed, SetAttitudeTarget,
                             CommandLong, CommandAck, ExtendedSysState, SysStatus, VisionPositionEstimate>;

// Who sends: a vehicle or a ground station, and its part. Component 0 stands for every component.
struct Sender {
  std::uint8_t system = 1, component = 1;
};

inline constexpr std::size_t kMaxFrame = 280;  // bytes: header, payload, checksum, signature

// Makes frames, and counts them as the protocol demands.
class Encoder {
 public:
  explicit Encoder(Sender self) : self_(self) {}
  // The frame, valid until the next call.
  std::span<const std::uint8_t> encode(const Message& message);

 private:
  Sender self_;
  std::uint8_t sequence_ = 0;
  std::array<std::uint8_t, kMaxFrame> frame_{};
};

// What the parser passed over, and why.
enum class Skipped : std::uint8_t {
  kNoise,      // bytes outside frames; all others are counted in frames
  kMavlink1,   // a good frame of protocol version 1
  kFlags,      // incompatibility flags that are not known here (1: signed)
  kOther,      // a message that is of no use here: nothing is wrong
  kChecksum,   // damaged
  kSystem,     // good, but from another system
  kComponent,  // good, but from another part of the right system
};
inline constexpr int kNumSkipped = 7;
const char* to_string(Skipped reason);

// Finds the frames of one sender in a stream of bytes. A frame counts when its checksum is good; after anything else
// the search goes on at the next byte, so that no good frame is lost behind garbage. What a payload lacks are
// zeros, whatever its length; what is beyond the message is an extension that is not known here. Keeps less than one
// frame.
class Parser {
 public:
  using Taker = std::function<void(const Message&)>;

  explicit Parser(Sender from) : from_(from) {}
  void feed(std::span<const std::uint8_t> bytes, const Taker& take);

  std::int64_t frames() const { return frames_; }
  std::int64_t skipped(Skipped reason) const { return skipped_[static_cast<std::size_t>(reason)]; }

 private:
  // How many bytes at the front of `bytes` are done with; 0: more are needed to tell.
  std::size_t parse(std::span<const std::uint8_t> bytes, const Taker& take);
  std::size_t parse_version_1(std::span<const std::uint8_t> bytes);
  // One byte is no beginning of a frame...
  std::size_t pass_over();
  // ... or the beginning of one that is passed over, with `more` bytes of it to come.
  std::size_t pass_over(Skipped reason, std::size_t more);
  // A whole frame with a good checksum.
  std::size_t finish(std::size_t size);
  bool is_expected(Sender sender);
  void count(Skipped reason) { ++skipped_[static_cast<std::size_t>(reason)]; }

  Sender from_;
  std::array<std::uint8_t, kMaxFrame> pending_{};
  std::size_t num_pending_ = 0;
  std::size_t foreign_ = 0;  // so many of the next bytes seem to belong to a frame that is passed over
  std::int64_t frames_ = 0;
  std::array<std::int64_t, kNumSkipped> skipped_{};
};

}  // namespace swarm::mavlink
