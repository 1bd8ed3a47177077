#include "lcmtypes/bus/lock_file.h"

#include <fcntl.h>
#include <linux/magic.h>
#include <sys/file.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace swarm {

namespace {

std::runtime_error not_locked(const std::filesystem::path& path, const std::string& reason) {
  return std::runtime_error(path.string() + ": cannot be locked: " + reason);
}

}  // namespace

void lock_open_file(int descriptor, const std::filesystem::path& path, const std::function<void()>& is_taken) {
  if (::flock(descriptor, LOCK_EX | LOCK_NB) == 0) return;
  if (errno == EWOULDBLOCK) {
    is_taken();
    if (::flock(descriptor, LOCK_EX) == 0) return;
  }
  throw not_locked(path, std::strerror(errno));
}

LockFile::LockFile(const std::filesystem::path& path, const std::string& who)
    : descriptor_(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NONBLOCK, 0600)) {
  if (descriptor_ < 0) throw not_locked(path, std::strerror(errno));
  try {
    lock_open_file(descriptor_, path, [&] { throw not_locked(path, who); });
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

LockFile::~LockFile() {
  ::close(descriptor_);
}

bool LockFile::is_in_memory() const {
  struct statfs file_system {};
  return ::fstatfs(descriptor_, &file_system) == 0 &&
         (file_system.f_type == TMPFS_MAGIC || file_system.f_type == RAMFS_MAGIC);
}

}  // namespace swarm
