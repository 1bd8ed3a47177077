// Recorded scans: PCD files (ascii or binary, whatever other fields there are) and KITTI's .bin.
//
// The room tools/scans/ plays what a range sensor has recorded onto the bus.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace swarm {

// The points of a scan in the sensor's frame [m]. Those that are no numbers, as organised clouds have where nothing was
// measured, are left out. Throws std::runtime_error with path, what is wrong and the rule. At most kMaxCloudBytes.
std::vector<Eigen::Vector3d> read_point_cloud(const std::filesystem::path& path);
inline constexpr std::uintmax_t kMaxCloudBytes = 256'000'000;

// What such files hold; complaints begin with `name`.
std::vector<Eigen::Vector3d> points_of_pcd(const std::string& name, std::string_view bytes);
std::vector<Eigen::Vector3d> points_of_kitti(const std::string& name, std::string_view bytes);

}  // namespace swarm
