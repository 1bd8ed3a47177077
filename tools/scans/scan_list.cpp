#include "tools/scans/scan_list.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <string>

namespace swarm {
namespace {

double seconds_of(const std::string& text, const std::string& where, const std::string& rule) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
    throw std::runtime_error(where + ": '" + text + "' must be " + rule);
  return value;
}

std::vector<double> read_times(const std::filesystem::path& path) {
  std::ifstream in(path);
  if (!in) throw std::runtime_error(path.string() + ": must be a readable file");
  std::vector<double> times;
  for (std::string word; in >> word;)
    times.push_back(seconds_of(word, path.string() + ", time " + std::to_string(times.size()), "seconds"));
  return times;
}

}  // namespace

std::vector<RecordedScan> list_scans(const std::filesystem::path& directory, const std::filesystem::path& times) {
  std::error_code error;
  std::vector<RecordedScan> scans;
  for (const auto& entry : std::filesystem::directory_iterator(directory, error)) {
    const std::filesystem::path& file = entry.path();
    if (file.extension() == ".pcd" || file.extension() == ".bin") scans.push_back({0.0, file});
  }
  if (error) throw std::runtime_error(directory.string() + ": must be a readable directory");
  if (scans.empty()) throw std::runtime_error(directory.string() + ": must have files .pcd or .bin");
  std::ranges::sort(scans, {}, &RecordedScan::file);
  if (!times.empty()) {
    const std::vector<double> listed = read_times(times);
    if (listed.size() != scans.size())
      throw std::runtime_error(times.string() + ": has " + std::to_string(listed.size()) + " times, but " +
                               directory.string() + " " + std::to_string(scans.size()) + " scans");
    for (std::size_t i = 0; i < scans.size(); ++i) scans[i].t_s = listed[i];
  } else {
    for (RecordedScan& scan : scans) {
      const std::string name = scan.file.stem().string(), rule = "seconds with a decimal point, or say --times FILE";
      if (name.find('.') == std::string::npos)
        throw std::runtime_error(scan.file.string() + ": its name '" + name + "' must be " + rule);
      scan.t_s = seconds_of(name, scan.file.string(), rule);
    }
    std::ranges::sort(scans, {}, &RecordedScan::t_s);
  }
  for (std::size_t i = 1; i < scans.size(); ++i)
    if (scans[i].t_s <= scans[i - 1].t_s)
      throw std::runtime_error(scans[i].file.string() + ": time " + std::to_string(scans[i].t_s) +
                               ": must be later than that before");
  return scans;
}

}  // namespace swarm
