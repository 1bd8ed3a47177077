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
    EXPECT_EQ(first.load(), PromiseStore::Copies(2, Bytes{4}));
    EXPECT_THROW(FilePromiseStore{path}, std::runtime_error);  // is in use
  }
  FilePromiseStore store(path);
  EXPECT_EQ(store.load(), PromiseStore::Copies(2, Bytes{4}));
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

// One damaged copy costs nothing, and of two whole ones the newer counts; so it is where saving was interrupted.
TEST(PromiseStore, OneCopyIsEnough) {
  const TemporaryDirectory directory;
  const auto path = directory.path() / "robot4.promise", copy = directory.path() / "robot4.promise.copy";
  sogm_swarm::announcement_t kept{};
  kept.radius = 0.2f;
  const auto promise = [&](std::int64_t seq) {
    kept.header = make_header(4, 100, seq, kStart);
    kept.committed = Trajectory::hover(3, kStart, {static_cast<double>(seq), 2, 1}).to_wire();
    return promise_bytes({kept, {}, {}}, {});
  };
  const auto kept_x = [&] {
    FilePromiseStore store(path);
    const KeptPromise start = load_promise(store, 4, 7);
    EXPECT_EQ(start.boot, start.motion ? 101 : 7);
    return start.motion ? start.motion->at(kStart).position.x() : -1.0;
  };
  ASSERT_TRUE(FilePromiseStore(path).save(promise(1)));
  for (const auto& damaged : {path, copy}) {
    SCOPED_TRACE(damaged);
    const std::string whole = read_text(damaged);
    for (std::size_t bit = 0; bit < 8 * whole.size(); bit += 101) {
      std::string text = whole;
      text[bit / 8] = static_cast<char>(text[bit / 8] ^ 1 << bit % 8);
      write_text(damaged, text);
      ASSERT_EQ(kept_x(), 1.0);
    }
    write_text(damaged, whole.substr(0, whole.size() / 2));
    EXPECT_EQ(kept_x(), 1.0);
    write_text(damaged, "");
    EXPECT_EQ(kept_x(), 1.0);
    std::filesystem::remove(damaged);
    std::filesystem::create_directory(damaged);
    EXPECT_EQ(kept_x(), 1.0);
    EXPECT_TRUE(FilePromiseStore(path).save(promise(1))) << "the other one is saved";
    std::filesystem::remove(damaged);
    write_text(damaged, whole);
  }
  for (const auto& older : {path, copy}) {
    ASSERT_TRUE(FilePromiseStore(path).save(promise(2)));
    const Bytes before = promise(1);
    write_text(older, {reinterpret_cast<const char*>(before.data()), before.size()});
    EXPECT_EQ(kept_x(), 2.0);
  }
  write_text(path, "x"), write_text(copy, "x");
  EXPECT_EQ(kept_x(), -1.0);
}

TEST(PromiseStore, AStartIsNewerThanWhatWasKept) {
  sogm_swarm::announcement_t kept{};
  kept.radius = 0.2f;
  kept.committed = Trajectory::hover(3, kStart, {1, 2, 1}).to_wire();
  MemoryPromiseStore store;
  const auto after = [&](std::int32_t boot, int robot) {
    kept.header = make_header(robot, boot, 0, kStart);
    sogm_swarm::flight_status_t flight{};
    flight.state = sogm_swarm::flight_status_t::kHome;
    EXPECT_TRUE(store.save(promise_bytes({kept, {}, {}}, flight)));
    return load_promise(store, 4, 7);
  };
  EXPECT_EQ(after(100, 4).boot, 101);
  EXPECT_EQ(after(100, 4).motion->at(kStart).position, Eigen::Vector3d(1, 2, 1));
  EXPECT_EQ(after(100, 4).flight->state, sogm_swarm::flight_status_t::kHome);
  EXPECT_EQ(after(100, 5).boot, 7);  // another robot's
  EXPECT_EQ(after(std::numeric_limits<std::int32_t>::max(), 4).boot, 7);
  EXPECT_TRUE(store.save(encoded(kept)));
  EXPECT_EQ(load_promise(store, 4, 7).boot, 7) << "half of it";
}

TEST(PromiseStore, KeepsTheCellsOfWhoFliesInThem) {
  CellAnnouncement kept{};
  kept.robot.header = make_header(4, 100, 1, kStart);
  kept.robot.radius = 0.2f;
  kept.robot.committed = Trajectory::hover(3, kStart, {1, 2, 1}).to_wire();
  kept.robot.least_delay_us = sogm_swarm::announcement_t::kUnknown;
  kept.cells[{0, -1}] = {(std::int64_t{100} << 32) + 7, true, 12};
  kept.cells[{2, 3}] = {(std::int64_t{99} << 32) + 2, false, -1};
  MemoryPromiseStore store;
  ASSERT_TRUE(store.save(promise_bytes(kept, {})));
  const KeptPromise start = load_promise(store, 4, 7);
  EXPECT_EQ(start.boot, 101);
  EXPECT_EQ(start.motion->at(kStart).position, Eigen::Vector3d(1, 2, 1));
  EXPECT_EQ(start.cells, kept.cells);
  for (int x = 0; x <= sogm_swarm::cell_announcement_t::kMaxCells; ++x) kept.cells[{x, 0}] = {1, true, 0};
  EXPECT_TRUE(promise_bytes(kept, {}).empty());
}

}  // namespace
}  // namespace swarm::test
