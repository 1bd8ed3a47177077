#include "lcmtypes/bus/lcm_wire.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

namespace swarm {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes random_bytes(std::size_t size, unsigned seed) {
  std::mt19937 random(seed);
  Bytes bytes(size);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

std::vector<Bytes> datagrams_of(const std::string& channel, const Bytes& bytes, std::uint32_t sequence = 7) {
  std::vector<Bytes> datagrams;
  const bool is_written = write_lcm(sequence, {channel, bytes}, [&](const auto& head, const auto& payload) {
    Bytes& datagram = datagrams.emplace_back(head.begin(), head.end());
    datagram.insert(datagram.end(), payload.begin(), payload.end());
    return true;
  });
  EXPECT_TRUE(is_written);
  return datagrams;
}

void put(Bytes* datagram, std::size_t at, std::uint32_t value, std::size_t bytes) {
  for (std::size_t i = 0; i < bytes; ++i)
    (*datagram)[at + i] = static_cast<std::uint8_t>(value >> (8 * (bytes - 1 - i)));
}

// What `reader` makes of the datagrams: the last message, if any.
std::optional<Bytes> read_all(LcmReader* reader, const std::vector<Bytes>& datagrams, std::uint64_t sender = 1) {
  std::optional<Bytes> heard;
  for (const Bytes& datagram : datagrams) {
    if (const auto message = reader->read(sender, datagram))
      heard.emplace(message->bytes.begin(), message->bytes.end());
  }
  return heard;
}

TEST(LcmWire, IsLiblcmsFormat) {
  const Bytes expected{'L', 'C', '0', '2', 0, 0, 1, 2, 'G', 'O', 0, 9, 8};
  EXPECT_EQ(datagrams_of("GO", {9, 8}, 258), std::vector<Bytes>{expected});
  const std::vector<Bytes> parts = datagrams_of("GO", random_bytes(65'500, 1), 258);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(Bytes(parts[0].begin(), parts[0].begin() + 23),
            (Bytes{'L', 'C', '0', '3', 0, 0, 1, 2, 0, 0, 0xff, 0xdc, 0, 0, 0, 0, 0, 0, 0, 2, 'G', 'O', 0}));
  EXPECT_EQ(parts[0].size(), 20u + 65'487u);
  EXPECT_EQ(Bytes(parts[1].begin(), parts[1].begin() + 20),  // from 65,484 on, since the channel took 3
            (Bytes{'L', 'C', '0', '3', 0, 0, 1, 2, 0, 0, 0xff, 0xdc, 0, 0, 0xff, 0xcc, 0, 1, 0, 2}));
}

TEST(LcmWire, CarriesAnySize) {
  LcmReader reader;
  const std::string longest(kMaxLcmChannel, 'X');
  for (const std::size_t size : {std::size_t{0}, std::size_t{1}, std::size_t{65'434}, std::size_t{65'435},
                                 std::size_t{65'436}, std::size_t{65'499}, std::size_t{300'000}, kMaxLcmMessage}) {
    const Bytes bytes = random_bytes(size, static_cast<unsigned>(size));
    for (const std::string& channel : {std::string("A"), longest}) {
      const std::vector<Bytes> datagrams = datagrams_of(channel, bytes);
      for (const Bytes& datagram : datagrams) EXPECT_LE(datagram.size(), kMaxDatagram);
      const std::optional<Bytes> heard = read_all(&reader, datagrams);
      ASSERT_TRUE(heard) << size;
      EXPECT_TRUE(*heard == bytes) << size;
    }
  }
  const auto never = [](const auto&, const auto&) { return ADD_FAILURE(), true; };
  EXPECT_FALSE(write_lcm(0, {"", {}}, never));
  EXPECT_FALSE(write_lcm(0, {longest + "X", {}}, never));
  EXPECT_FALSE(write_lcm(0, {"A", Bytes(kMaxLcmMessage + 1)}, never));
}

TEST(LcmWire, PutsFragmentsOfSeveralSendersTogether) {
  LcmReader reader;
  const Bytes first = random_bytes(200'000, 1), second = random_bytes(200'000, 2);
  const std::vector<Bytes> a = datagrams_of("A", first), b = datagrams_of("B", second);
  for (std::size_t i = 0; i + 1 < a.size(); ++i) {
    EXPECT_FALSE(reader.read(1, a[i]));
    EXPECT_FALSE(reader.read(2, b[i]));
    EXPECT_FALSE(reader.read(2, b[i])) << "a duplicate";
  }
  EXPECT_TRUE(reader.read(3, datagrams_of("C", {1})[0])) << "whole messages come in between";
  const auto last_b = reader.read(2, b.back());
  ASSERT_TRUE(last_b);
  EXPECT_TRUE(std::ranges::equal(last_b->bytes, second));
  const auto last_a = reader.read(1, a.back());
  ASSERT_TRUE(last_a);
  EXPECT_EQ(last_a->channel, "A");
  EXPECT_TRUE(std::ranges::equal(last_a->bytes, first));
}

TEST(LcmWire, LostFragmentsLoseOneMessage) {
  const std::vector<Bytes> datagrams = datagrams_of("A", random_bytes(300'000, 1), 1);
  for (std::size_t lost = 0; lost < datagrams.size(); ++lost) {
    LcmReader reader;
    std::vector<Bytes> heard = datagrams;
    heard.erase(heard.begin() + static_cast<std::ptrdiff_t>(lost));
    EXPECT_FALSE(read_all(&reader, heard)) << lost;
    EXPECT_TRUE(read_all(&reader, datagrams_of("A", random_bytes(300'000, 1), 2)));
  }
}

// Offsets near 2^32, sizes and counts that lie, no end of the channel: liblcm 1.3.1 dies of some of these.
TEST(LcmWire, RefusesForgedFragments) {
  const std::vector<Bytes> good = datagrams_of("A", random_bytes(100'000, 1));
  struct Field {
    std::size_t at, bytes;
  };
  for (const Field field : {Field{4, 4}, Field{8, 4}, Field{12, 4}, Field{16, 2}, Field{18, 2}}) {
    for (const std::uint32_t value : {0u, 1u, 3u, 0x7fffu, 0xffffu, 0x186a1u, 0x7fffffffu, 0xfffffff0u, 0xffffffffu}) {
      for (std::size_t i = 0; i < good.size(); ++i) {
        std::vector<Bytes> forged = good;
        put(&forged[i], field.at, value, field.bytes);
        if (forged == good) continue;
        LcmReader reader;
        EXPECT_FALSE(read_all(&reader, forged)) << field.at << ' ' << value << ' ' << i;
      }
    }
  }
  Bytes endless = good[0];
  for (std::size_t i = 20; i < endless.size(); ++i) endless[i] = 'A';
  LcmReader reader;
  EXPECT_FALSE(read_all(&reader, {endless, good[1]}));
  Bytes whole = datagrams_of("A", {})[0];
  EXPECT_TRUE(reader.read(1, whole));
  whole.back() = 'A';
  EXPECT_FALSE(reader.read(1, whole)) << "no end of the channel";
  for (std::size_t size = 0; size + 1 < whole.size(); ++size) EXPECT_FALSE(reader.read(1, Bytes(size, 'L')));
}

// Whatever comes: nothing but messages that were sent as one, or that say they are.
TEST(LcmWire, SurvivesNoise) {
  LcmReader reader;
  std::mt19937 random(5);
  const std::vector<Bytes> good = datagrams_of("A", random_bytes(150'000, 1));
  std::vector<Bytes> pool = good;
  for (int i = 0; i < 20'000; ++i) {
    Bytes datagram = pool[random() % pool.size()];
    datagram.resize(std::min<std::size_t>(datagram.size(), random() % 2 == 0 ? datagram.size() : random() % 64));
    for (unsigned flips = random() % 4; flips > 0 && !datagram.empty(); --flips) {
      datagram[random() % std::min<std::size_t>(datagram.size(), 24)] = static_cast<std::uint8_t>(random());
    }
    if (const auto message = reader.read(random() % 12, datagram)) {
      EXPECT_LE(message->bytes.size(), kMaxLcmMessage);
      EXPECT_LE(message->channel.size(), kMaxLcmChannel);
    }
  }
  EXPECT_TRUE(read_all(&reader, datagrams_of("A", random_bytes(150'000, 1), 99), 77));
}

}  // namespace
}  // namespace swarm
