// What a broadcast daemon keeps over a crash.
#include "planner_daemon/coordination/promise_store.h"

#include <sys/stat.h>

#include <filesystem>
#include <limits>
#include <stdexcept>

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

TEST(PromiseStore, TheFileIsReplacedAsAWhole) {
  const TemporaryDirectory directory;
  const std::filesystem::path path = directory.path() / "robot0.promise";
  {
    FilePromiseStore first(path);
    EXPECT_TRUE(first.load().empty());
    EXPECT_TRUE(first.save(Bytes{1, 2, 3}));
    EXPECT_TRUE(first.save(Bytes{4}));
    EXPECT_EQ(first.load(), Bytes{4});
    EXPECT_THROW(FilePromiseStore{path}, std::runtime_error);  // is in use
  }
  FilePromiseStore store(path);
  EXPECT_EQ(store.load(), Bytes{4});
  EXPECT_THROW(FilePromiseStore(directory.path() / "no" / "robot0.promise"), std::runtime_error);

  EXPECT_EQ(load_promise(store, 0, 7).boot, 7);  // damaged: as if there were none
  EXPECT_FALSE(load_promise(store, 0, 7).motion);
}

// None of them may hold up or fill a robot that starts.
TEST(PromiseStore, NoFileIsWaitedForOrReadWithoutEnd) {
  const TemporaryDirectory directory;
  const auto load = [&](const char* name) { return FilePromiseStore(directory.path() / name).load(); };
  ASSERT_EQ(::mkfifo((directory / "pipe").c_str(), 0600), 0);
  EXPECT_TRUE(load("pipe").empty());
  std::filesystem::create_directory(directory.path() / "folder");
  EXPECT_TRUE(load("folder").empty());
  write_text(directory / "long", std::string(400'000, 'x'));
  EXPECT_TRUE(load("long").empty());
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
