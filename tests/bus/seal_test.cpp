#include "lcmtypes/bus/seal.h"

#include <gtest/gtest.h>
#include <sodium.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "lcmtypes/bus/temporary_directory.h"

namespace swarm {
namespace {

using Bytes = std::vector<std::uint8_t>;

const std::string kOne(64, '1'), kTwo(64, '2'), kThree(64, '3');

Bytes sealed(const std::string& keys, const std::string& channel, Bytes bytes) {
  SwarmKeys(keys).seal(channel, &bytes);
  return bytes;
}

TEST(Seal, OpensWhatItSealed) {
  const SwarmKeys keys(kOne);
  for (const std::size_t size : {0u, 1u, 16u, 20u, 1431u, 60'000u}) {
    const Bytes message(size, 7), whole = sealed(kOne, "GO", message);
    EXPECT_EQ(whole.size(), size + kSealBytes);
    EXPECT_TRUE(keys.opens("GO", whole));
    EXPECT_TRUE(std::ranges::equal(without_seal(whole), message));
    EXPECT_TRUE(std::ranges::equal(without_seal(message), message));
  }
}

// The seal is what its comment says, so that others can write it.
TEST(Seal, IsKeyedBlake2b) {
  const Bytes whole = sealed(kOne, "GO", {9, 8});
  const Bytes key(32, 0x11), input{'G', 'O', 0, 9, 8};
  Bytes mac(16);
  ASSERT_EQ(::crypto_generichash(mac.data(), mac.size(), input.data(), input.size(), key.data(), key.size()), 0);
  Bytes expected{9, 8, 'S', 'E', 'A', 'L'};
  expected.insert(expected.end(), mac.begin(), mac.end());
  EXPECT_EQ(whole, expected);
}

TEST(Seal, RefusesEveryFlippedBitOtherChannelsAndKeys) {
  const SwarmKeys keys(kOne);
  Bytes whole = sealed(kOne, "GO", {1, 2, 3});
  for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
    whole[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
    EXPECT_FALSE(keys.opens("GO", whole)) << bit;
    whole[bit / 8] ^= static_cast<std::uint8_t>(1 << bit % 8);
  }
  EXPECT_TRUE(keys.opens("GO", whole));
  EXPECT_FALSE(keys.opens("GOAL", whole));
  EXPECT_FALSE(SwarmKeys(kTwo).opens("GO", whole));
  for (std::size_t size = 0; size < whole.size(); ++size) EXPECT_FALSE(keys.opens("GO", std::span(whole).first(size)));
}

TEST(Seal, KeysAreChangedInFlight) {
  const SwarmKeys before(kOne), both(kOne + "\n" + kTwo), turned(kTwo + "\n" + kOne), after(kTwo);
  const SwarmKeys* steps[] = {&before, &both, &turned, &after};
  for (int i = 0; i < 4; ++i) {
    for (const int other : {i - 1, i, i + 1}) {  // robots are at most one step apart
      if (other < 0 || other > 3) continue;
      Bytes bytes{1};
      steps[i]->seal("GO", &bytes);
      EXPECT_TRUE(steps[other]->opens("GO", bytes)) << i << other;
    }
  }
  Bytes bytes{1};
  before.seal("GO", &bytes);
  EXPECT_FALSE(after.opens("GO", bytes));
}

TEST(Seal, WithoutKeysNothingIsSealed) {
  Bytes bytes{1};
  SwarmKeys().seal("GO", &bytes);
  EXPECT_EQ(bytes, Bytes{1});
  EXPECT_FALSE(SwarmKeys().opens("GO", sealed(kOne, "GO", {1})));
}

TEST(Seal, KeysAreNamedByLineButNeverShown) {
  EXPECT_FALSE(SwarmKeys("# ours\n\n" + kOne + "\r\n").empty());
  EXPECT_NE(SwarmKeys::fresh(), SwarmKeys::fresh());
  EXPECT_EQ(SwarmKeys::fresh().size(), 65u);
  for (const std::string& text :
       {std::string(), std::string("# none\n"), kOne.substr(1), kOne + "1", kOne + " ", "x" + kOne,
        kOne.substr(1) + "g", kOne + "\n" + kTwo + "\n" + kThree, std::string(64, '\0')}) {
    try {
      SwarmKeys keys(text);
      ADD_FAILURE() << text;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).find("111"), std::string::npos) << error.what();
    }
  }
}

TEST(Seal, KeyFilesAreRegularSmallAndPrivate) {
  const TemporaryDirectory directory("seal");
  const auto path = [&](const char* name) { return directory.path() / name; };
  const auto write = [&](const char* name, const std::string& text, unsigned mode) {
    std::ofstream(path(name)) << text;
    ::chmod(path(name).c_str(), mode);
  };
  const auto error = [&](const char* name) -> std::string {
    try {
      (void)SwarmKeys::read(path(name));
    } catch (const std::runtime_error& refused) {
      EXPECT_NE(std::string(refused.what()).find(path(name).string()), std::string::npos) << refused.what();
      return refused.what();
    }
    return "";
  };
  write("good", kOne + "\n", 0600);
  EXPECT_EQ(error("good"), "");
  EXPECT_NE(error("none").find("new_key"), std::string::npos);
  write("open", kOne, 0644);
  EXPECT_NE(error("open").find("chmod"), std::string::npos);
  write("long", std::string(5000, '#'), 0600);
  EXPECT_NE(error("long").find("4096"), std::string::npos);
  write("bad", "hello", 0600);
  EXPECT_NE(error("bad").find("line 1"), std::string::npos);
  std::filesystem::create_directory(path("folder"));
  EXPECT_NE(error("folder").find("regular"), std::string::npos);
  ASSERT_EQ(::mkfifo(path("pipe").c_str(), 0600), 0);
  EXPECT_NE(error("pipe").find("regular"), std::string::npos);
}

}  // namespace
}  // namespace swarm
