#include "lcmtypes/bus/packed_announcement.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "lcmtypes/bus/bit_coding.h"
#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/validate.h"

namespace swarm {

using namespace sogm_swarm;
using namespace bit_coding;

namespace {

constexpr std::array kUsualPieces_us{200'000, 100'000};  // others take 24 bits
constexpr double kMillimetres = 1000.0;                  // in a metre

std::int64_t rounded_quotient(std::int64_t value, std::int64_t divisor) {
  return (value + (value < 0 ? -divisor : divisor) / 2) / divisor;
}

// Takes note whether Rice codes do.
struct RiceTrial {
  static constexpr bool kReads = false;
  void number(std::uint64_t&) {}
  void rice(int k, std::uint64_t& value) { fits = fits && value >> static_cast<unsigned>(k) <= kMostZeros; }
  void refuse() {}
  bool fits = true;
};

// Of one axis, in steps; [0] of all knots.
struct AxisSteps {
  using Knots = std::array<std::int64_t, kMaxTrajectoryPieces + 1>;
  Knots p{}, v{}, a{};
};
constexpr auto kMaxP = static_cast<std::int64_t>(kMaxPosition_m * kStepsPerMetre);
constexpr auto kMaxV = static_cast<std::int64_t>(kMaxVelocity_mps * kStepsPerMps);
constexpr auto kMaxA = static_cast<std::int64_t>(kMaxAcceleration_mps2 * kStepsPerMps2);

enum class AxisForm : std::uint8_t { kStands, kRice, kNumbers };  // in two bits

// How large differences lately were: four times their mean, the older ones counting less and less.
class Spread {
 public:
  explicit Spread(std::uint64_t first) : sum_(first) {}
  // For Rice codes of such differences.
  int k() const { return std::min(static_cast<int>(std::bit_width(sum_ >> 3u)), 31); }
  void saw(std::uint64_t difference) { sum_ += difference - (sum_ >> 2u); }

 private:
  std::uint64_t sum_;
};

// A knot is expected to go on from the one before: with its acceleration; then with the mean of both accelerations;
// then as the quintic does that has no more than a cubic's freedom.
template <class Bits>
void code_knots(Bits& bits, AxisForm form, int num_pieces, std::int64_t piece_us, AxisSteps& axis) {
  Spread of_a(400), of_v(80), of_p(24);
  const auto code = [&](std::int64_t expected, std::int64_t bound, Spread& spread, std::int64_t& value) {
    expected = std::clamp(expected, -bound, bound);
    std::uint64_t difference = zigzag(value - expected);
    form == AxisForm::kRice ? bits.rice(spread.k(), difference) : bits.number(difference);
    spread.saw(difference);
    if constexpr (Bits::kReads) {
      value = expected + unzigzag(difference);
      if (value < -bound || value > bound) value = 0, bits.refuse();
    }
  };
  for (int i = 1; i <= num_pieces; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const std::int64_t a0 = axis.a[at - 1], v0 = axis.v[at - 1];
    std::int64_t &a1 = axis.a[at], &v1 = axis.v[at];  // of the last one 0
    if (i < num_pieces) {
      code(a0, kMaxA, of_a, a1);
      code(v0 + rounded_quotient(5 * (a0 + a1) * piece_us, 1'000'000), kMaxV, of_v, v1);
    }
    const std::int64_t bend = rounded_quotient(5 * (a0 - a1) * piece_us, 1000);
    const std::int64_t way = rounded_quotient(5 * (v0 + v1) * piece_us, 1'000'000);
    code(axis.p[at - 1] + way + rounded_quotient(5 * bend * piece_us, 3'000'000'000), kMaxP, of_p, axis.p[at]);
  }
}

bool stands(const AxisSteps& axis, int num_pieces) {
  for (std::size_t i = 0; i <= static_cast<std::size_t>(num_pieces); ++i) {
    if (axis.p[i] != axis.p[0] || axis.v[i] != 0 || axis.a[i] != 0) return false;
  }
  return true;
}

template <class Bits>
void code(Bits& bits, int num_pieces, std::int64_t piece_us, AxisSteps& axis) {
  auto form = AxisForm::kStands;
  if constexpr (!Bits::kReads) {
    if (!stands(axis, num_pieces)) {
      RiceTrial trial;
      code_knots(trial, AxisForm::kRice, num_pieces, piece_us, axis);
      form = trial.fits ? AxisForm::kRice : AxisForm::kNumbers;
    }
  }
  auto number = static_cast<std::uint64_t>(form);
  bits.bits(2, number);
  if (number > static_cast<std::uint64_t>(AxisForm::kNumbers)) bits.refuse(), number = 0;
  form = static_cast<AxisForm>(number);
  const auto first = [&](std::int64_t bound, std::int64_t& value) {
    relative(bits, 0, value);
    if (value < -bound || value > bound) value = 0, bits.refuse();
  };
  first(kMaxP, axis.p[0]);
  if (form == AxisForm::kStands) return axis.p.fill(axis.p[0]);
  first(kMaxV, axis.v[0]);
  first(kMaxA, axis.a[0]);
  code_knots(bits, form, num_pieces, piece_us, axis);
}

template <class Bits>
void code(Bits& bits, std::int64_t utime, std::int32_t seq, trajectory_t& m) {
  relative(bits, seq, m.seq);
  relative(bits, utime, m.start_utime);
  const auto* usual = std::ranges::find(kUsualPieces_us, m.piece_us);
  auto place = static_cast<std::uint64_t>(usual - kUsualPieces_us.begin());
  bits.bits(2, place);
  auto piece_us = static_cast<std::uint64_t>(m.piece_us), num_pieces = static_cast<std::uint64_t>(m.num_pieces);
  if (place > kUsualPieces_us.size()) bits.refuse();
  place < kUsualPieces_us.size() ? void(piece_us = static_cast<std::uint64_t>(kUsualPieces_us[place]))
                                 : bits.bits(24, piece_us);
  bits.bits(4, num_pieces);
  if (num_pieces < 1 || num_pieces > kMaxTrajectoryPieces) bits.refuse(), num_pieces = 1;
  m.piece_us = static_cast<std::int32_t>(piece_us);
  m.num_pieces = static_cast<std::int16_t>(num_pieces);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    AxisSteps steps;
    if constexpr (!Bits::kReads) {
      for (std::size_t i = 0; i <= num_pieces; ++i) {
        steps.p[i] = std::llround(kStepsPerMetre * m.knots[i][axis]);
        if (i == num_pieces) continue;
        steps.v[i] = std::llround(kStepsPerMps * m.knots[i][3 + axis]);
        steps.a[i] = std::llround(kStepsPerMps2 * m.knots[i][6 + axis]);
      }
    }
    code(bits, m.num_pieces, m.piece_us, steps);
    for (std::size_t i = 0; i <= num_pieces; ++i) {
      m.knots[i][axis] = static_cast<float>(static_cast<double>(steps.p[i]) / kStepsPerMetre);
      m.knots[i][3 + axis] = static_cast<float>(static_cast<double>(steps.v[i]) / kStepsPerMps);
      m.knots[i][6 + axis] = static_cast<float>(static_cast<double>(steps.a[i]) / kStepsPerMps2);
    }
  }
}

// Boots are near each other, as robots start together: by their differences to the sender's, all in the same width.
// Whether a robot was given up is said of each as soon as one was.
template <class Bits>
void code_acks(Bits& bits, std::int32_t boot, std::vector<ack_t>& acks) {
  std::uint64_t width = 0;
  for (const ack_t& ack : acks) {
    if (ack.peer_boot < 0) continue;
    width = std::max(width, static_cast<std::uint64_t>(std::bit_width(zigzag(std::int64_t{ack.peer_boot} - boot))));
  }
  bits.bits(6, width);
  if (width > 32) bits.refuse(), width = 0;
  const auto gives_up = [](const ack_t& ack) { return ack.verdict == ack_t::kGivenUp; };
  bool gives_up_any = std::ranges::any_of(acks, gives_up);
  flag(bits, gives_up_any);
  for (ack_t& ack : acks) {
    bool is_heard = ack.peer_boot >= 0, is_judged = ack.judged_seq > 0, is_nack = ack.verdict == ack_t::kNack;
    bool is_given_up = gives_up(ack);
    if (gives_up_any) flag(bits, is_given_up);
    flag(bits, is_heard);
    if (!is_heard) {
      ack = {-1, 0, is_given_up ? ack_t::kGivenUp : ack_t::kNone};
      continue;
    }
    std::uint64_t difference = zigzag(std::int64_t{ack.peer_boot} - boot);
    bits.bits(static_cast<int>(width), difference);
    set_checked(bits, boot + unzigzag(difference), ack.peer_boot);
    if (ack.peer_boot < 0) bits.refuse();
    if (is_given_up) {
      whole(bits, ack.judged_seq);
      ack.verdict = ack_t::kGivenUp;
      continue;
    }
    flag(bits, is_judged);
    ack.verdict = ack_t::kNone;
    if (!is_judged) continue;
    whole(bits, ack.judged_seq);
    if (ack.judged_seq == 0) bits.refuse();
    flag(bits, is_nack);
    ack.verdict = is_nack ? ack_t::kNack : ack_t::kAck;
  }
}

template <class Bits>
void code(Bits& bits, announcement_t& m) {
  auto radius_mm = static_cast<std::uint64_t>(std::max(1.0, std::ceil(kMillimetres * m.radius - 1e-3)));
  bits.number(radius_mm);
  m.radius = static_cast<float>(static_cast<double>(radius_mm) / kMillimetres);
  auto crc = static_cast<std::uint64_t>(static_cast<std::uint32_t>(m.roster_crc));
  bits.bits(32, crc);
  m.roster_crc = static_cast<std::int32_t>(static_cast<std::uint32_t>(crc));
  whole(bits, m.forced_seq);
  bool knows_delay = m.least_delay_us != announcement_t::kUnknown;
  flag(bits, knows_delay);
  knows_delay ? relative(bits, 0, m.least_delay_us) : void(m.least_delay_us = announcement_t::kUnknown);
  code(bits, m.header.utime, 0, m.committed);
  auto state = static_cast<std::uint64_t>(m.pending_state);
  bits.bits(2, state);
  m.pending_state = static_cast<std::int8_t>(state);
  if (m.pending_state == announcement_t::kNone) {
    m.pending = {};
    m.pending_stamp = 0;
  } else {
    relative(bits, m.header.utime, m.pending_stamp);
    code(bits, m.header.utime, m.committed.seq, m.pending);
  }
  auto num_acks = static_cast<std::uint64_t>(m.acks.size());
  bits.bits(6, num_acks);
  if (num_acks > static_cast<std::uint64_t>(kMaxRosterRobots)) bits.refuse(), num_acks = 0;
  m.num_acks = static_cast<std::int16_t>(num_acks);
  m.acks.resize(num_acks);
  code_acks(bits, m.header.boot, m.acks);
}

}  // namespace

packed_announcement_t pack(announcement_t* message) {
  packed_announcement_t packed;
  BitWriter bits(&packed.packed);
  code(bits, *message);
  bits.finish();
  message->header.crc32 = 0;
  packed.header = message->header;
  packed.num_bytes = static_cast<std::int16_t>(packed.packed.size());
  return packed;
}

Refusal unpack(const packed_announcement_t& packed, announcement_t* message) {
  std::vector<ack_t> acks = std::move(message->acks);  // their memory
  acks.clear();
  *message = {};
  message->acks = std::move(acks);
  message->header = packed.header;
  message->header.crc32 = 0;
  BitReader bits(packed.packed);
  code(bits, *message);
  if (const Refusal refusal = bits.finish(); refusal != Refusal::kNone) return refusal;
  return validate(*message);
}

last_words_t last_words_of(announcement_t* message) {
  packed_announcement_t packed = pack(message);
  last_words_t words;
  words.robot_id = packed.header.robot_id;
  words.boot = packed.header.boot;
  words.seq = packed.header.seq;
  words.utime = packed.header.utime;
  words.num_bytes = packed.num_bytes;
  words.packed = std::move(packed.packed);
  return words;
}

Refusal unpack(const last_words_t& words, announcement_t* message) {
  packed_announcement_t packed;
  packed.header = {0, words.header.schema_version, words.robot_id, words.boot, words.seq, words.utime};
  packed.num_bytes = words.num_bytes;
  packed.packed = words.packed;
  return unpack(packed, message);
}

void encode_packed(announcement_t* message, std::vector<std::uint8_t>* bytes) {
  encode(pack(message), bytes);
}

Refusal decode_packed(std::span<const std::uint8_t> bytes, announcement_t* message) {
  packed_announcement_t packed;
  if (const Refusal refusal = decode(bytes, &packed); refusal != Refusal::kNone) return refusal;
  return unpack(packed, message);
}

}  // namespace swarm
