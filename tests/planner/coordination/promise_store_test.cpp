// What a broadcast daemon keeps over a crash.
#include "planner_daemon/coordination/promise_store.h"

#include <limits>

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

TEST(PromiseStore, TheFileIsReplacedAsAWhole) {
  const TemporaryDirectory directory;
  FilePromiseStore store(directory.path() / "robot0.promise");
  EXPECT_TRUE(store.load().empty());
  EXPECT_TRUE(store.save(Bytes{1, 2, 3}));
  EXPECT_TRUE(store.save(Bytes{4}));
  EXPECT_EQ(store.load(), Bytes{4});
  EXPECT_EQ(FilePromiseStore(directory.path() / "robot0.promise").load(), Bytes{4});
  EXPECT_FALSE(FilePromiseStore(directory.path() / "no" / "robot0.promise").save(Bytes{4}));

  EXPECT_EQ(load_promise(store, 0, 7).boot, 7);  // damaged: as if there were none
  EXPECT_FALSE(load_promise(store, 0, 7).motion);
}

TEST(PromiseStore, AStartIsNewerThanWhatWasKept) {
  sogm_swarm::announcement_t kept{};
  kept.radius = 0.2f;
  kept.committed = Trajectory::hover(3, kStart, {1, 2, 1}).to_wire();
  MemoryPromiseStore store;
  const auto after = [&](std::int32_t boot, int robot) {
    kept.header = make_header(robot, boot, 0, kStart);
    EXPECT_TRUE(store.save(encoded(kept)));
    return load_promise(store, 4, 7);
  };
  EXPECT_EQ(after(100, 4).boot, 101);
  EXPECT_EQ(after(100, 4).motion->at(kStart).position, Eigen::Vector3d(1, 2, 1));
  EXPECT_EQ(after(100, 5).boot, 7);  // another robot's
  EXPECT_EQ(after(std::numeric_limits<std::int32_t>::max(), 4).boot, 7);
}

}  // namespace
}  // namespace swarm::test
