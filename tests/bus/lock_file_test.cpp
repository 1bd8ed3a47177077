// One at a time has a file, until it lets go or is gone.
#include "lcmtypes/bus/lock_file.h"

#include <memory>

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

std::string complaint_about(const std::filesystem::path& path) {
  try {
    const LockFile lock(path, "another has it");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(LockFile, OneHasItAtATime) {
  const TemporaryDirectory directory;
  const std::filesystem::path path = directory / "lock";
  {
    const LockFile lock(path, "another has it");
    EXPECT_EQ(complaint_about(path), path.string() + ": cannot be locked: another has it");
    EXPECT_EQ(complaint_about(directory / "other"), "");
  }
  EXPECT_EQ(complaint_about(path), "") << "it was let go";
}

TEST(LockFile, WhoIsGoneHasLetGo) {
  const TemporaryDirectory directory;
  const std::filesystem::path path = directory / "lock";
  int said[2];
  ASSERT_EQ(::pipe(said), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const LockFile lock(path, "another has it");
    (void)!::write(said[1], "x", 1);
    ::pause();
  }
  char ignored = 0;
  ASSERT_EQ(::read(said[0], &ignored, 1), 1);
  EXPECT_EQ(complaint_about(path), path.string() + ": cannot be locked: another has it");
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  EXPECT_EQ(complaint_about(path), "");
  for (const int end : said) ::close(end);
}

TEST(LockFile, WhatIsInTheWayIsNamed) {
  const TemporaryDirectory directory;
  const std::filesystem::path path = directory / "no" / "lock";
  EXPECT_EQ(complaint_about(path), path.string() + ": cannot be locked: No such file or directory");
}

TEST(LockFile, WhoeverHasTimeWaits) {
  const TemporaryDirectory directory;
  const std::filesystem::path path = directory / "lock";
  auto lock = std::make_unique<LockFile>(path, "another has it");
  const int descriptor = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GE(descriptor, 0);
  std::thread holder;
  lock_open_file(descriptor, path, [&] {
    holder = std::thread([&lock] {
      std::this_thread::sleep_for(50ms);
      lock.reset();
    });
  });
  ASSERT_TRUE(holder.joinable()) << "it was taken";
  holder.join();
  EXPECT_EQ(complaint_about(path), path.string() + ": cannot be locked: another has it");
  ::close(descriptor);
  EXPECT_EQ(complaint_about(path), "");
  EXPECT_THROW(lock_open_file(-1, path, [] {}), std::runtime_error);
}

TEST(LockFile, KnowsMemoryFromDisks) {
  if (std::filesystem::is_directory("/dev/shm")) {
    const TemporaryDirectory memory("swarm", "/dev/shm");
    EXPECT_TRUE(LockFile(memory / "lock", "").is_in_memory());
  }
}

}  // namespace
}  // namespace swarm::test
