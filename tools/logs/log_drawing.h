// Draws what robots say on their buses, as messages of Foxglove's schemas: transforms, scenes and point clouds.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/recurring.h"
#include "map_daemon/sogm_codec.h"
#include "planner_daemon/trajectory/mission.h"
#include "planner_daemon/trajectory/trajectory.h"
#include "tools/logs/scan_picture.h"
#include "tools/logs/sogm_surface.h"

namespace swarm {

struct Drawing {
  std::string topic;
  const char* schema;  // its name, see foxglove.h
  nlohmann::ordered_json message;
};

struct DrawingOptions {
  double map_interval_s = 0.0;  // of a robot's maps, those that follow sooner on the one drawn last are not drawn
};

// Each scene holds everything of its topic, so that a viewer that starts anywhere needs the newest one alone.
//   /tf                    FrameTransforms: from "world" to "robot<K>", position and yaw
//   /robot<K>/scene        SceneUpdate: the robot's sphere, its trajectories (the pending one fainter), its goals; when
//                          any of it changes, and with announcements every 0.1 s
//   /robot<K>/obstacles    SceneUpdate: columns, rings, boxes and spheres where they are at the message's time, and
//                          fainter two standard deviations around them
//   /robot<K>/obstacle_voxels  SceneUpdate: the cubes of each set, for 1 s; one set a message
//   /robot<K>/sogm         PointCloud: centres of the map's surface voxels, t: start of the first frame in which the
//                          voxel is occupied [s after the map's start]
//   /robot<K>/corridors    SceneUpdate: the polytopes of the newest plan
//   /robot<K>/lidar<S>     PointCloud: what one of its sensors saw, as far as perception looks, t: 1 on a robot, or 0
//   /robot<K>/depth<S>     the same of a camera
//   /robot<K>/masks        SceneUpdate: the balls in which points of the newest scan are taken for robots
//   /robot<K>/seen_space   PointCloud: as sogm, of what perception holds to stand, t: 0
class LogDrawing {
 public:
  using Sink = std::function<void(const Drawing&)>;

  LogDrawing(const DrawingOptions& options, Sink sink) : options_(options), sink_(std::move(sink)) {}

  // A message that passed decode(), recorded at `utime`, not before the epoch, which becomes the drawing's time. The
  // same announcement may come several times, as by both buses: the first counts.
  template <class T>
  void add(Utime utime, std::string_view channel, const T& m) {
    if constexpr (std::is_same_v<T, sogm_swarm::sogm_t>) {
      draw_grid(utime, channel == channel::kSeenSpace, m);
    } else {
      draw(utime, m);
    }
  }

 private:
  // A grid that comes in parts.
  struct Grid {
    SogmAssembler assembler;
    Recurring drawn;
  };
  struct Robot {
    std::optional<Eigen::Vector3d> position;  // W [m], newest
    Mission mission;                          // newest
    bool has_frame = false;                   // its state was heard
    std::optional<float> radius_m;
    Trajectory committed, pending;  // newest; pending may be empty
    SequenceGate announcements;
    Recurring scene;  // drawn
    Grid map, seen_space;
    ScanPictures scans;
  };

  void draw(Utime utime, const sogm_swarm::announcement_t& m);
  void draw(Utime utime, const sogm_swarm::corridors_t& m);
  void draw(Utime utime, const sogm_swarm::depth_image_t& m);
  void draw(Utime utime, const sogm_swarm::goal_t& m);
  void draw(Utime utime, const sogm_swarm::lidar_scan_t& m);
  void draw(Utime utime, const sogm_swarm::obstacle_voxels_t& m);
  void draw(Utime utime, const sogm_swarm::obstacles_t& m);
  void draw(Utime utime, const sogm_swarm::robot_state_t& m);
  template <class T>
  void draw(Utime, const T&) {}  // of the others nothing
  void draw_grid(Utime utime, bool is_seen_space, const sogm_swarm::sogm_t& m);
  void draw_scan(Utime utime, int id, const std::string& sensor, const ScanPicture* scan);
  void draw_scene(Utime utime, int id, Robot* robot);

  DrawingOptions options_;
  Sink sink_;
  std::map<int, Robot> robots_;
  PeerMask masks_ = usual_peer_mask();
  Sogm grid_;
  std::vector<SurfaceVoxel> surface_;
};

}  // namespace swarm
