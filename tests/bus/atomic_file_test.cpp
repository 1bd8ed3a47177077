// Files appear whole or not at all, and a full disk is said to be full.
#include "lcmtypes/bus/atomic_file.h"

#include <unistd.h>

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

TEST(AtomicFile, IsThereWithAllThatWasWritten) {
  const TemporaryDirectory directory;
  const std::filesystem::path path = directory / "file";
  write_file(path, "first");
  write_file(path, "second");
  EXPECT_EQ(read_text(path), "second");
}

TEST(AtomicFile, AFullDiskIsSaidAndChangesNothing) {
  const TemporaryDirectory directory;
  const std::filesystem::path path = directory / "file";
  write_file(path, "first");
  std::filesystem::create_symlink("/dev/full", path.string() + ".part" + std::to_string(::getpid()));
  try {
    write_file(path, "second");
    FAIL() << "it was written";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(error.what(), path.string() + ": cannot be written: No space left on device");
  }
  EXPECT_EQ(read_text(path), "first");
}

}  // namespace
}  // namespace swarm::test
