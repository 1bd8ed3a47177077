// A frame of the view's stream as a page reads it, see tools/viewer/picture_frame.h.
#pragma once

#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace swarm::test {

using WebJson = nlohmann::ordered_json;

struct ViewFrame {
  WebJson text;
  std::string arrays;

  explicit ViewFrame(const std::string& bytes) {
    std::uint32_t length = 0;
    if (bytes.size() < sizeof length) throw std::runtime_error("no frame");
    std::memcpy(&length, bytes.data(), sizeof length);
    if ((4 + length) % 4 != 0 || bytes.size() < 4 + length) throw std::runtime_error("frame of a wrong length");
    text = WebJson::parse(bytes.substr(4, length));
    arrays = bytes.substr(4 + length);
  }
  template <class Number>
  std::vector<Number> numbers(const WebJson& place) const {
    std::vector<Number> all(place.at("count").get<std::size_t>());
    const std::size_t at = place.at("at").get<std::size_t>(), size = all.size() * sizeof(Number);
    if (at % 4 != 0 || at + size > arrays.size()) throw std::runtime_error("array beyond the frame");
    if (size > 0) std::memcpy(all.data(), arrays.data() + at, size);
    return all;
  }
  const WebJson* robot(int id) const {
    for (const WebJson& robot : text.at("robots"))
      if (robot.at("id") == id) return &robot;
    return nullptr;
  }
};

}  // namespace swarm::test
