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

LockFile::LockFile(const std::filesystem::path& path, const std::string& who)
    : descriptor_(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NONBLOCK, 0600)) {
  if (descriptor_ >= 0 && ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0) return;
  const std::string reason = errno == EWOULDBLOCK ? who : std::strerror(errno);
  if (descriptor_ >= 0) ::close(descriptor_);
  throw std::runtime_error(path.string() + ": cannot be locked: " + reason);
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
