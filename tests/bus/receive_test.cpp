// The order of the checks of every message, and what is done again and again while clocks go back.
#include "lcmtypes/bus/receive.h"

#include <string>
#include <vector>

#include "lcmtypes/bus/recurring.h"
#include "tests/support/random_messages.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using namespace random_messages;

struct Receiver {
  std::vector<std::string> asked;
  Refusal from_refuses = Refusal::kNone, order_refuses = Refusal::kNone;

  Refusal hear(const goal_t& sent, std::size_t bytes_missing = 0) {
    std::vector<std::uint8_t> bytes;
    encode(sent, &bytes);
    bytes.resize(bytes.size() - bytes_missing);
    asked.clear();
    const auto from = [this](const goal_t&) { return asked.emplace_back("from"), from_refuses; };
    const auto order = [this](const goal_t&) { return asked.emplace_back("order"), order_refuses; };
    goal_t goal;
    return receive(bytes, from, {kStart, 1s, 100ms}, order, &goal);
  }
};

goal_t goal_of(Utime utime, int robot_id = 3, std::int64_t seq = 7) {
  goal_t goal{};
  goal.header.schema_version = header_t::kSchemaVersion;
  goal.header.robot_id = static_cast<std::int16_t>(robot_id);
  goal.header.seq = seq;
  goal.header.utime = to_us(utime);
  goal.num_waypoints = 1;
  goal.waypoints.emplace_back();
  return goal;
}

TEST(Receive, AsksForTheSenderThenTheTimeThenTheOrder) {
  using Asked = std::vector<std::string>;
  Receiver receiver;
  EXPECT_EQ(receiver.hear(goal_of(kStart)), Refusal::kNone);
  EXPECT_EQ(receiver.asked, (Asked{"from", "order"}));
  EXPECT_EQ(receiver.hear(goal_of(kStart), 1), Refusal::kLength);
  EXPECT_EQ(receiver.asked, Asked());
  EXPECT_EQ(receiver.hear(goal_of(kStart + 100ms)), Refusal::kNone);
  EXPECT_EQ(receiver.hear(goal_of(kStart + 100'001us)), Refusal::kTime);
  EXPECT_EQ(receiver.asked, Asked{"from"});
  EXPECT_EQ(receiver.hear(goal_of(kStart - 1s)), Refusal::kNone);
  EXPECT_EQ(receiver.hear(goal_of(kStart - 1'000'001us)), Refusal::kTime);
  receiver.order_refuses = Refusal::kValue;
  EXPECT_EQ(receiver.hear(goal_of(kStart)), Refusal::kValue);
  receiver.from_refuses = Refusal::kLength;
  EXPECT_EQ(receiver.hear(goal_of(kStart - 1'000'001us)), Refusal::kLength);
  EXPECT_EQ(receiver.asked, Asked{"from"});
}

TEST(Receive, WhatIsRefusedUsesUpNoNumber) {
  SequenceGate gate;
  const auto hear = [&gate](const goal_t& sent, const TimeWindow& window) {
    std::vector<std::uint8_t> bytes;
    encode(sent, &bytes);
    goal_t goal;
    return receive(bytes, FromRobot{3}, window, gate, &goal);
  };
  const TimeWindow lately{kStart, 1s, 100ms};
  EXPECT_EQ(hear(goal_of(kStart, 4), lately), Refusal::kRobot);
  EXPECT_EQ(hear(goal_of(Utime()), lately), Refusal::kTime);
  EXPECT_EQ(hear(goal_of(kStart), lately), Refusal::kNone);
  EXPECT_EQ(hear(goal_of(kStart), lately), Refusal::kSequence);
  EXPECT_EQ(hear(goal_of(Utime(), 3, 8), TimeWindow()), Refusal::kNone);  // any time will do
  EXPECT_EQ(hear(goal_of(kMaxUtime, 3, 9), TimeWindow()), Refusal::kNone);
}

TEST(Channels, EachIsOfOneTypeAndOneBus) {
  std::size_t known = 0;
  const auto count = [&]<class... T>(const std::tuple<T...>*) {
    for (const Channel& channel : kChannels) known += (0 + ... + static_cast<int>(is_carried_by<T>(channel.name)));
  };
  count(static_cast<AllMessages*>(nullptr));
  EXPECT_EQ(known, std::size(kChannels));
  EXPECT_EQ(channels_of(BusId::kOnboard).size() + channels_of(BusId::kSwarm).size(), std::size(kChannels));
  EXPECT_EQ(std::string(channel::kPeerTrajectory), "PEER_TRAJECTORY");
  EXPECT_TRUE(is_carried_by<announcement_t>(channel::kPeerTrajectory));
  EXPECT_FALSE(is_carried_by<announcement_t>(channel::kSogm));
}

// What the list says of arrays is what the generated types do.
TEST(Messages, ArraysHaveTheBytesOfTheirElements) {
  Random random(1);
  int arrays = 0;
  const auto check = [&]<class T>(const T*) {
    if constexpr (!std::is_same_v<decltype(MessageTraits<T>::kArray), const NoArray>) {
      const auto bytes = [&](int elements) {
        const T message = make<T>(random, elements);
        return message.getEncodedSize() - static_cast<int>(MessageTraits<T>::kArray.element_bytes *
                                                           (message.*MessageTraits<T>::kArray.elements).size());
      };
      EXPECT_EQ(bytes(5), T{}.getEncodedSize()) << T::getTypeName();
      ++arrays;
    }
  };
  [&]<class... T>(const std::tuple<T...>*) {
    (check(static_cast<T*>(nullptr)), ...);
  }(static_cast<AllMessages*>(nullptr));
  EXPECT_EQ(arrays, 12);
}

TEST(Recurring, IsDueAPeriodAfterItWasDone) {
  Recurring recurring;
  EXPECT_LE(recurring.due(kStart, 500us), kStart);
  recurring.done(kStart);
  EXPECT_EQ(recurring.due(kStart, 500us), kStart + 500us);
  EXPECT_EQ(recurring.due(kStart + 10s, 500us), kStart + 500us);
  EXPECT_EQ(recurring.due_on_grid(kStart, 300us), to_utime(to_us(kStart) / 300 * 300 + 300));
}

TEST(Recurring, NothingWaitsForTheTimeThatWasBefore) {
  Recurring recurring;
  recurring.done(kStart);
  const Utime back = kStart - 5s;
  EXPECT_EQ(recurring.due(back, 500us), back + 500us);
  EXPECT_EQ(recurring.due(back + 400us, 500us), back + 500us);
  EXPECT_LE(recurring.due_on_grid(back - 1s, 500us), back - 1s + 500us);
}

}  // namespace
}  // namespace swarm
