// A directory for files that nobody needs afterwards.
#pragma once

#include <stdlib.h>

#include <filesystem>
#include <stdexcept>
#include <string>
#include <system_error>

namespace swarm {

// Removes itself and what it holds.
class TemporaryDirectory {
 public:
  // In `parent`, by default where the system keeps such things, as `name` and six letters. Throws std::runtime_error
  // with that path.
  explicit TemporaryDirectory(const std::string& name = "swarm",
                              const std::filesystem::path& parent = std::filesystem::temp_directory_path()) {
    std::string pattern = (parent / (name + ".XXXXXX")).string();
    if (::mkdtemp(pattern.data()) == nullptr) throw std::runtime_error(pattern + ": cannot be made");
    path_ = pattern;
  }
  ~TemporaryDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace swarm
