// A scan in the steady state takes no memory from the heap: from its message to the obstacles, to what was seen, and to
// the messages that say so.
#include <gtest/gtest.h>

#include <numbers>

#include "map_daemon/perception/perception_node.h"
#include "tests/support/allocations.h"
#include "tests/support/column_scan.h"
#include "tests/support/harness.h"

#ifdef SWARM_COUNTS_ALLOCATIONS
namespace swarm::test {
namespace {

constexpr int kScannerId = 3;

// Nobody hears the messages.
class Nowhere : public Outbox {
 public:
  void publish_bytes(BusId, std::string_view, std::span<const std::uint8_t>) override { ++messages; }

  int messages = 0;
};

// People walk to and fro in a room, one behind the other and past each other, and out of its walls; the robot flies a
// circle. All of it comes again after `kScansARound` scans.
constexpr int kScansARound = 100;
std::vector<Column> room_at(int scan) {
  std::vector<Column> columns;
  for (double y = -4.0; y <= 4.0; y += 0.05)
    if (std::abs(y - 1.0) > 0.6) columns.push_back({{3.5, y}, 0.03, 0.0, 2.5});
  for (double x = -2.0; x <= 2.0; x += 0.05) columns.push_back({{x, -2.5}, 0.03, 0.0, 2.5});
  for (int i = 0; i < 8; ++i) {
    const double angle = 2.0 * std::numbers::pi * (static_cast<double>(scan) / kScansARound * (1 + i % 2) + i / 8.0);
    columns.push_back({{1.5 + 0.2 * i + 1.2 * std::cos(angle), 1.6 * std::sin(angle)}, 0.15 + 0.02 * i});
  }
  return columns;
}
Eigen::Vector3d place_at(int scan) {
  const double angle = 2.0 * std::numbers::pi * scan / kScansARound;
  return {-1.0 + 0.5 * std::cos(angle), 0.5 * std::sin(angle), 1.0 + 0.1 * std::sin(angle)};
}

template <class MessageOf>
void expect_no_allocations(const MessageOf& message_of, std::string_view channel) {
  std::vector<decltype(message_of(place_at(0), room_at(0)))> messages;
  for (int i = 0; i < kScansARound; ++i) messages.push_back(message_of(place_at(i), room_at(i)));
  PerceptionNodeConfig config;
  config.robot_id = kScannerId;
  for (const bool explores : {true, false}) {
    config.perception.explores = explores;
    PerceptionNode node(config, 1);
    Nowhere nowhere;
    Utime now = kStart;
    int moving = 0, taking = 0;
    for (int scan = 0; scan < 6 * kScansARound; ++scan) {
      now += 100ms;
      auto& message = messages[static_cast<std::size_t>(scan % kScansARound)];
      message.header = make_header(kScannerId, 1, scan, now);
      const Bytes bytes = encoded(message);
      const int taken = allocations_of([&] {
        node.on_message(now, BusId::kOnboard, channel, bytes, nowhere);
        node.step(now, nowhere);
      });
      for (const Track& track : node.perception().tracker().tracks()) moving += node.perception().is_moving(track);
      if (scan >= 2 * kScansARound && taken > 0) ++taking;
    }
    // One that has more pieces at once than all before takes what it needs, and keeps it.
    EXPECT_LE(taking, 2) << "of 400 scans, explores: " << explores;
    EXPECT_EQ(node.refused().total(), 0);
    EXPECT_GT(nowhere.messages, 12 * kScansARound);
    EXPECT_GT(moving, 6 * kScansARound) << "there was something to do";
  }
}

TEST(PerceptionAllocation, ALidarsScansTakeNoMemory) {
  expect_no_allocations(column_scan, channel::kLidarScan);
}

TEST(PerceptionAllocation, ACamerasImagesTakeNoMemory) {
  expect_no_allocations(column_image, channel::kDepthImage);
}

}  // namespace
}  // namespace swarm::test
#else
TEST(PerceptionAllocation, CannotBeCounted) {
  GTEST_SKIP() << "the allocator is not glibc's own";
}
#endif
