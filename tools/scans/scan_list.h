// Which scans there are, and when they were taken.
#pragma once

#include <filesystem>
#include <vector>

namespace swarm {

struct RecordedScan {
  double t_s = 0.0;  // by the clock of the poses
  std::filesystem::path file;
};

// All files .pcd and .bin of a directory, in the order of their names; their names are their times, in seconds with a
// decimal point, or `times` has a time a line for each of them, as KITTI's times.txt (empty: there is none). Throws
// std::runtime_error with path, what is wrong and the rule: times must grow, and there must be a scan.
std::vector<RecordedScan> list_scans(const std::filesystem::path& directory, const std::filesystem::path& times);

}  // namespace swarm
