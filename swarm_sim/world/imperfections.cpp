#include "swarm_sim/world/imperfections.h"

#include <array>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/option_set.h"
#include "tools/scans/pose_file.h"

namespace swarm {

std::string listed(std::span<const char* const> words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i)
    text.append(i == 0 ? "" : i + 1 == words.size() ? " or " : ", ").append(words[i]);
  return text;
}

std::vector<Mount> parse_mounts(const std::string& text) {
  if (text.empty()) return {Mount{}};
  const auto fail = [] {
    throw OptionError("must be YAW[:PITCH[:X:Y:Z]],...: at most " + std::to_string(kMaxSensors) +
                      " sensors, degrees within [-180, 180] and metres within [-2, 2]");
  };
  std::vector<Mount> mounts;
  std::istringstream sensors(text);
  for (std::string sensor; std::getline(sensors, sensor, ',');) {
    std::array<double, 5> values{};
    std::size_t count = 0;
    std::istringstream numbers(sensor);
    for (std::string number; std::getline(numbers, number, ':'); ++count) {
      if (count == values.size()) fail();
      std::istringstream one(number);
      const double limit = count < 2 ? 180.0 : 2.0;
      if (!(one >> values[count]) || !one.eof() || !(std::abs(values[count]) <= limit)) fail();
    }
    if (sensor.empty() || sensor.back() == ':' || (count != 1 && count != 2 && count != 5)) fail();
    mounts.push_back({values[0], values[1], {values[2], values[3], values[4]}});
  }
  if (text.back() == ',' || std::ssize(mounts) > kMaxSensors) fail();
  return mounts;
}

void check_pose_drift(const std::string& file) {
  if (file.empty()) return;
  try {
    (void)PoseTrack(file);
  } catch (const std::runtime_error& error) {
    throw OptionError(std::string("must be a file of poses; ") + error.what());
  }
}

}  // namespace swarm
