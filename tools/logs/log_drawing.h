// Draws what robots say on their buses, as messages of Foxglove's schemas: transforms, scenes and point clouds.
#pragma once

#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/recurring.h"
#include "map_daemon/sogm_codec.h"
#include "planner_daemon/trajectory/mission.h"
#include "planner_daemon/trajectory/trajectory.h"
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
//   /robot<K>/obstacles    SceneUpdate: columns, rings, boxes and spheres where they are at the message's time
//   /robot<K>/obstacle_voxels  SceneUpdate: the cubes of each set, for 1 s; one set a message
//   /robot<K>/sogm         PointCloud: centres of the map's surface voxels, t: start of the first frame in which the
//                          voxel is occupied [s after the map's start]
//   /robot<K>/corridors    SceneUpdate: the polytopes of the newest plan
class LogDrawing {
 public:
  using Sink = std::function<void(const Drawing&)>;

  LogDrawing(const DrawingOptions& options, Sink sink) : options_(options), sink_(std::move(sink)) {}

  // A message that passed decode(), recorded at `utime`, not before the epoch, which becomes the drawing's time. The
  // same announcement may come several times, as by both buses: the first counts.
  void add(Utime utime, const sogm_swarm::announcement_t& m);
  void add(Utime utime, const sogm_swarm::corridors_t& m);
  void add(Utime utime, const sogm_swarm::goal_t& m);
  void add(Utime utime, const sogm_swarm::obstacle_voxels_t& m);
  void add(Utime utime, const sogm_swarm::obstacles_t& m);
  void add(Utime utime, const sogm_swarm::robot_state_t& m);
  void add(Utime utime, const sogm_swarm::sogm_t& m);
  // Of the others nothing is drawn.
  template <class T>
  void add(Utime, const T&) {}

 private:
  struct Robot {
    std::optional<Eigen::Vector3d> position;  // W [m], newest
    Mission mission;                          // newest
    bool has_frame = false;                   // its state was heard
    std::optional<float> radius_m;
    Trajectory committed, pending;  // newest; pending may be empty
    SequenceGate announcements;
    Recurring scene, map;  // drawn
    SogmAssembler assembler;
  };

  void draw_scene(Utime utime, int id, Robot* robot);

  DrawingOptions options_;
  Sink sink_;
  std::map<int, Robot> robots_;
  Sogm map_;
  std::vector<SurfaceVoxel> surface_;
};

}  // namespace swarm
