// Recorded scans and poses: they are read or refused with one line that names the file, and take no more memory than
// the file has.
#include <cmath>
#include <stdexcept>
#include <string>

#include "tests/fuzz/fuzz_input.h"
#include "tools/scans/point_cloud_file.h"
#include "tools/scans/pose_file.h"

namespace swarm::fuzz {

void try_input(FuzzInput input) {
  const int kind = input.integer(0, 2);
  const auto rest = input.rest();
  const std::string bytes(rest.begin(), rest.end());
  const MemoryFile file(rest);
  std::string name = "scan.pcd";
  try {
    if (kind == 0) {
      for (const Eigen::Vector3d& point : points_of_pcd(name, bytes)) expect(point.allFinite(), "points are numbers");
    } else if (kind == 1) {
      expect(points_of_kitti(name, bytes).size() <= bytes.size() / 16, "there are no more points than bytes for them");
    } else {
      name = file.path();
      const PoseTrack track(name);
      const double middle_s = track.begin_s() + 0.5 * (track.end_s() - track.begin_s());
      for (const double t_s : {track.begin_s(), track.end_s(), middle_s}) {
        const TimedPose pose = track.at(t_s);
        expect(pose.position.cwiseAbs().maxCoeff() <= 1e5 * (1 + 1e-9), "places are where poses are");
        expect(std::abs(pose.orientation.norm() - 1.0) < 1e-6, "orientations are of unit length");
      }
    }
  } catch (const std::runtime_error& error) {
    const std::string_view line = error.what();
    expect(line.find(name) != line.npos && line.find('\n') == line.npos, "one line names the file");
  }
}

}  // namespace swarm::fuzz
