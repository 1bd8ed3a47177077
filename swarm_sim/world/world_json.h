// World files (JSON): strict reading, and writing that reads back as the same world.
//
//   {"name": "cross-mixed-30-5",
//    "space": {"min": [-8,-8,0], "max": [8,8,4]},
//    "obstacle_bounds": {"min": [-7,-7], "max": [7,7]},        optional: space
//    "limits": {"speed": 2.0, "acceleration": 6.0},            per axis
//    "sensing_radius": 5.0,                                    optional: 5
//    "options": {"vehicle": "quadrotor", "wind-mps": 3},       optional: as options of swarm_sim run
//    "static_map": "map.bt",                                   optional: none; OctoMap file, relative to the world file
//    "robots": [{"id": 0, "start": [-8,0,1], "goal": [8,0,1], "radius": 0.2}],
//         or "goals": [{"position": [0,0,1], "tolerance": 0.5, "speed": 1.0, "wait": 2.0}, {"position": [8,0,1]}]
//    "obstacles": [
//     {"shape": "column", "center": [1,2], "diameter": 0.8, "height": 4, "velocity": [0.3,-0.2]},
//     {"shape": "ring", "center": [0,3,1.2], "radius": 1.5, "width": 0.1, "yaw": 0.4, "velocity": [0.1,0.6]},
//     {"shape": "box", "center": [0,3,1], "size": [1,0.5,2], "yaw": 0.4},
//     {"shape": "sphere", "center": [0,3,1], "diameter": 0.4, "velocity": [0,0.4], "acceleration": 1},
//     {"shape": "column", "diameter": 0.5, "height": 1.8, "track": [[0,1,2],[0.4,1.3,2]]}]}
//
// Metres, seconds, radians. `velocity`, `acceleration` (a number: world.h) and `yaw` are optional (0); a column stands
// on the ground unless its centre has a z. A track's points are (t, x, y) and exclude `velocity` and `acceleration`;
// its `center`, optional for columns, gives the height and must agree with the first point. A ring is a torus: `radius`
// is its major radius, `width` the diameter of its tube.
#pragma once

#include <filesystem>
#include <string>

#include "swarm_sim/world/world.h"

namespace swarm {

// Reads one world. `source` opens every error line; a relative static_map is taken from `directory`.
// Throws WorldError "source: key: value rule", also for what check_world refuses.
World parse_world(const std::string& text, const std::string& source, const std::filesystem::path& directory);

// parse_world on a file.
World read_world(const std::filesystem::path& path);

// One robot and one obstacle a line, keys in a fixed order, shortest numbers that read back exactly. `directory` is
// where the text will lie: static_map is written relative to it.
std::string to_json_text(const World& world, const std::filesystem::path& directory);

}  // namespace swarm
