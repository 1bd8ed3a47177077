#include "tools/scans/point_cloud_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

namespace swarm {
namespace {

static_assert(std::endian::native == std::endian::little);  // as these files are

[[noreturn]] void fail(const std::string& name, const std::string& what) {
  throw std::runtime_error(name + ": " + what);
}

std::string read_all(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) fail(path.string(), "must be a readable file");
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (error || size > kMaxCloudBytes)
    fail(path.string(), "has " + std::to_string(size) + " bytes; at most " + std::to_string(kMaxCloudBytes));
  std::ifstream in(path, std::ios::binary);
  std::string bytes(size, '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(size));
  if (!in) fail(path.string(), "cannot be read");
  return bytes;
}

double number_at(const char* bytes, std::size_t size) {
  if (size == sizeof(float)) {
    float value;
    std::memcpy(&value, bytes, sizeof value);
    return value;
  }
  double value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

void keep(const Eigen::Vector3d& point, std::vector<Eigen::Vector3d>* points) {
  if (point.allFinite()) points->push_back(point);
}

// The words of a line behind its first one.
std::vector<std::string> words_of(const std::string& line) {
  std::istringstream in(line);
  std::vector<std::string> words;
  for (std::string word; in >> word;) words.push_back(word);
  return words;
}

std::size_t count_of(const std::string& name, const std::string& key, const std::string& word, std::size_t most) {
  std::size_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size() || value > most)
    fail(name, key + " " + word + ": must be a whole number within [0, " + std::to_string(most) + "]");
  return value;
}

// What the header of a PCD file says.
class PcdHeader {
 public:
  PcdHeader(const std::string& name, std::string_view bytes) : name_(name) {
    for (std::size_t at = 0; at < bytes.size();) {
      const std::size_t end = std::min(bytes.find('\n', at), bytes.size());
      std::vector<std::string> words = words_of(std::string(bytes.substr(at, end - at)));
      at = end + 1;
      if (words.empty() || words[0].starts_with('#')) continue;
      const std::string key = words[0];
      words.erase(words.begin());
      read(key, words);
      if (key != "DATA") continue;
      data_begins = std::min(at, bytes.size());
      break;
    }
    if (data_begins == 0) fail(name_, "must be a PCD file: it has no line DATA");
    check();
  }

  struct Field {
    std::size_t word, offset, size;  // the word of a line of text, the place in a point [bytes]
  };
  std::array<Field, 3> axes;
  std::size_t points = 0, words_per_point = 0, bytes_per_point = 0, data_begins = 0;
  bool is_text = false;

 private:
  void read(const std::string& key, const std::vector<std::string>& words) {
    const auto counts = [&](std::size_t most) {
      std::vector<std::size_t> values;
      values.reserve(words.size());
      for (const std::string& word : words) values.push_back(count_of(name_, key, word, most));
      return values;
    };
    if (key == "FIELDS") names_ = words;
    if (key == "SIZE") sizes_ = counts(8);
    if (key == "COUNT") counts_ = counts(10'000);
    if (key == "TYPE") types_ = words;
    if (key == "POINTS" && !words.empty()) points = counts(kMaxCloudBytes)[0];
    if (key == "DATA") {
      if (words.size() != 1 || (words[0] != "ascii" && words[0] != "binary"))
        fail(name_,
             "DATA " + (words.empty() ? "" : words[0]) + ": must be ascii or binary (pcl_convert_pcd_ascii_binary)");
      is_text = words[0] == "ascii";
    }
  }

  void check() {
    if (counts_.empty()) counts_.assign(names_.size(), 1);
    if (names_.empty() || sizes_.size() != names_.size() || types_.size() != names_.size() ||
        counts_.size() != names_.size())
      fail(name_, "FIELDS, SIZE, TYPE and COUNT must name as many fields each");
    std::array<std::optional<Field>, 3> found;
    for (std::size_t i = 0; i < names_.size(); ++i) {
      const auto axis = names_[i] == "x" ? 0u : names_[i] == "y" ? 1u : names_[i] == "z" ? 2u : 3u;
      if (axis < 3) {
        if (types_[i] != "F" || (sizes_[i] != 4 && sizes_[i] != 8) || counts_[i] != 1)
          fail(name_, "field " + names_[i] + ": must be one number of TYPE F and SIZE 4 or 8");
        found[axis] = Field{words_per_point, bytes_per_point, sizes_[i]};
      }
      words_per_point += counts_[i];
      bytes_per_point += counts_[i] * sizes_[i];
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!found[axis]) fail(name_, std::string("has no field ") + "xyz"[axis]);
      axes[axis] = *found[axis];
    }
  }

  const std::string& name_;
  std::vector<std::string> names_, types_;
  std::vector<std::size_t> sizes_, counts_;
};

std::vector<Eigen::Vector3d> read_binary(const std::string& name, const PcdHeader& header, std::string_view data) {
  if (data.size() / header.bytes_per_point < header.points)
    fail(name, "ends after " + std::to_string(data.size() / header.bytes_per_point) + " of its " +
                   std::to_string(header.points) + " points");
  std::vector<Eigen::Vector3d> points;
  points.reserve(header.points);
  for (std::size_t i = 0; i < header.points; ++i) {
    const char* point = data.data() + i * header.bytes_per_point;
    Eigen::Vector3d place;
    for (int axis = 0; axis < 3; ++axis) {
      const PcdHeader::Field& field = header.axes[static_cast<std::size_t>(axis)];
      place[axis] = number_at(point + field.offset, field.size);
    }
    keep(place, &points);
  }
  return points;
}

std::vector<Eigen::Vector3d> read_text(const std::string& name, const PcdHeader& header, std::string_view data) {
  std::vector<Eigen::Vector3d> points;
  std::istringstream in{std::string(data)};
  std::string line;
  for (std::size_t i = 0; i < header.points; ++i) {
    if (!std::getline(in, line))
      fail(name, "ends after " + std::to_string(i) + " of its " + std::to_string(header.points) + " points");
    const std::vector<std::string> words = words_of(line);
    if (words.size() != header.words_per_point)
      fail(name, "point " + std::to_string(i) + ": has " + std::to_string(words.size()) + " numbers, not " +
                     std::to_string(header.words_per_point));
    Eigen::Vector3d place;
    for (int axis = 0; axis < 3; ++axis) {
      const std::string& word = words[header.axes[static_cast<std::size_t>(axis)].word];
      const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), place[axis]);
      if (error != std::errc() || end != word.data() + word.size())
        fail(name, "point " + std::to_string(i) + ": '" + word + "' must be a number");
    }
    keep(place, &points);
  }
  return points;
}

}  // namespace

// x, y, z and the strength of the echo, as floats, one point after the other.
std::vector<Eigen::Vector3d> points_of_kitti(const std::string& name, std::string_view bytes) {
  constexpr std::size_t kPoint = 4 * sizeof(float);
  if (bytes.size() % kPoint != 0)
    fail(name,
         "has " + std::to_string(bytes.size()) + " bytes; must be a multiple of 16: x, y, z, intensity as floats");
  std::vector<Eigen::Vector3d> points;
  points.reserve(bytes.size() / kPoint);
  for (std::size_t at = 0; at < bytes.size(); at += kPoint) {
    const auto number = [&](std::size_t k) { return number_at(bytes.data() + at + k * sizeof(float), sizeof(float)); };
    keep({number(0), number(1), number(2)}, &points);
  }
  return points;
}

std::vector<Eigen::Vector3d> points_of_pcd(const std::string& name, std::string_view bytes) {
  const PcdHeader header(name, bytes);
  const std::string_view data = bytes.substr(header.data_begins);
  return header.is_text ? read_text(name, header, data) : read_binary(name, header, data);
}

std::vector<Eigen::Vector3d> read_point_cloud(const std::filesystem::path& path) {
  const std::string bytes = read_all(path);
  if (path.extension() == ".bin") return points_of_kitti(path.string(), bytes);
  if (path.extension() == ".pcd") return points_of_pcd(path.string(), bytes);
  fail(path.string(), "must end with .pcd or .bin");
}

}  // namespace swarm
