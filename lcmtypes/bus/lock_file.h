// A file that one process has at a time, until it lets go or is gone.
#pragma once

#include <filesystem>
#include <string>

namespace swarm {

class LockFile {
 public:
  // Makes the file where there is none. Throws std::runtime_error with path and reason: `who` has it, in words, or it
  // cannot be locked.
  LockFile(const std::filesystem::path& path, const std::string& who);
  ~LockFile();
  LockFile(const LockFile&) = delete;
  LockFile& operator=(const LockFile&) = delete;

  bool is_in_memory() const;  // where no disk is waited for

 private:
  int descriptor_;
};

}  // namespace swarm
