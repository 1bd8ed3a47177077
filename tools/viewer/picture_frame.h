// A picture of the swarm as a browser takes it: one binary message, little-endian: the length of a JSON text (uint32),
// that text (UTF-8), filled up with blanks to a multiple of four bytes in all, then arrays of numbers. Where the text
// names an array it says {"at": byte after the text, "count": numbers}.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <vector>

#include "swarm_sim/world/occupied_cubes.h"
#include "tools/viewer/swarm_picture.h"

namespace swarm {

using Json = nlohmann::ordered_json;

class FrameWriter {
 public:
  template <class Number>
  Json array(std::span<const Number> numbers) {
    static_assert(sizeof(Number) == 4 || sizeof(Number) == 2);
    while (arrays_.size() % 4 != 0) arrays_.push_back(0);
    Json place = {{"at", arrays_.size()}, {"count", numbers.size()}};
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(numbers.data());
    arrays_.insert(arrays_.end(), bytes, bytes + numbers.size_bytes());
    return place;
  }
  void finish(const Json& text, std::vector<std::uint8_t>* bytes) const;
  void clear() { arrays_.clear(); }

 private:
  std::vector<std::uint8_t> arrays_;
};

// Places [m], goals, trajectories as float32 triples, ages [s], rates [Hz] and counters of every robot.
Json robots_json(const SwarmPicture& picture, Utime now, FrameWriter* writer);

// `looker`: see SwarmPicture::obstacles.
Json obstacles_json(const SwarmPicture& picture, Utime now, int looker);

// The surface voxels of a frame, or for -1 of all, each with the first frame that it is occupied in: int16 x, y, z in
// the window, frame.
Json sogm_json(const Sogm& sogm, int frame, FrameWriter* writer);

// What the robot's sensors saw within the last second: float32 x, y, z [m], 1 on a robot or else 0; and the balls that
// robots are taken to be in.
Json scans_json(const RobotPicture& robot, Utime now, FrameWriter* writer);

// The faces of the corridor's polytopes, as triangles, and their edges: float32 triples.
Json corridors_json(const RobotPicture& robot, FrameWriter* writer);

// Occupied cubes: float32 centre and edge.
Json static_map_json(const OccupiedCubes& cubes, FrameWriter* writer);

}  // namespace swarm
