// Where obstacles are, and how well that is known, from what sensors and trackers report of them: a Kalman filter each
// (constant velocity, driven by white acceleration), which goes on for a while when its obstacle is not seen.
#pragma once

#include <cstdint>
#include <vector>

#include "map_daemon/obstacle.h"
#include "sogm_swarm/obstacles_t.hpp"

namespace swarm {

struct TrackerConfig {
  double acceleration_mps2 = 0.5;  // of obstacles, over a second: how fast what is known of them grows old
  double timeout_s = 1.0;          // what is not reported for so long is forgotten
  double latency_s = 0.0;          // of reports that do not know their age
};

// Variances of an axis, the same for all three: of position, of velocity, and what they have in common.
struct TrackCovariance {
  double position = 0.0, both = 0.0, velocity = 0.0;  // [m^2], [m^2/s], [m^2/s^2]

  // After `dt_s` >= 0 more, with white acceleration of density `density` [m^2/s^3].
  TrackCovariance after(double dt_s, double density) const;
};

struct Track {
  std::int32_t id = 0;
  Obstacle obstacle;  // the estimate, as of obstacle.utime
  TrackCovariance covariance;
  Eigen::Vector3d lasting_velocity = Eigen::Vector3d::Zero();  // averaged over the last half second, W [m/s]
  double changes = 0.0;    // mean square of how far the velocity is from that, less what noise makes of it [m^2/s^2]
  Utime unbroken_utime{};  // since when the velocity has changed little by little only
  Utime first_utime{}, last_utime{};  // of the first and of the newest report
};

// Standard deviations of an axis [m], [m/s]: of where it is at `utime` if it keeps its velocity, and of that.
double position_sigma_m(const Track& track, Utime utime);
double velocity_sigma_mps(const Track& track);

class Tracker {
 public:
  explicit Tracker(const TrackerConfig& config);

  // A report that passed decode(), newer than those before. What it lacks is gone where it is complete; otherwise it
  // may only be out of sight, and is kept for as long as it was seen, or nearly so, at most until the timeout.
  void update(const sogm_swarm::obstacles_t& report);
  // Forgets what was last reported more than the timeout before `now`; of a time that lies `ahead` of now or more, too.
  void forget(Utime now, Duration ahead);
  // The clock was set by `step`.
  void shift(Duration step);

  const std::vector<Track>& tracks() const { return tracks_; }  // by id

 private:
  struct Detection {
    std::int32_t id = 0;
    Obstacle obstacle;
    double position_var = 0.0, velocity_var = 0.0;
    bool has_velocity = true;
  };
  Detection detection_of(const sogm_swarm::obstacle_t& message, Utime utime) const;
  Track begun(const Detection& detection, Utime utime) const;
  void correct(const Detection& detection, Utime utime, Track* track) const;
  // Tracks that nobody reported take over the reports of ids that are new, where they fit.
  void adopt(Utime utime, std::vector<Track>* unseen, std::vector<Detection>* unknown,
             std::vector<Track>* tracks) const;
  bool is_kept(const Track& track, Utime utime) const;
  double density() const { return config_.acceleration_mps2 * config_.acceleration_mps2; }  // over one second

  TrackerConfig config_;
  std::vector<Track> tracks_;
  // Of update(), whose memory is kept for the next.
  std::vector<Detection> seen_, unknown_;
  std::vector<Track> unseen_, found_;
  std::vector<std::size_t> order_;
};

}  // namespace swarm
