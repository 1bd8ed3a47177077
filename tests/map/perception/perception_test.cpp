// From scans to obstacles: what stands, what moves and how fast, how high it is, what was seen, and what is a robot.
#include "map_daemon/perception/perception.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include <octomap/OcTree.h>

#include "lcmtypes/bus/temporary_directory.h"
#include "tests/support/column_scan.h"
#include "tests/support/start_time.h"

namespace swarm::test {
namespace {

const Eigen::Vector3d kSensor(0.03, 0.04, 1.05);

// Perception that looks ten times a second.
class Looking {
 public:
  explicit Looking(const PerceptionConfig& config = {}) : perception(config), config_(config) {}

  void look(const std::vector<Column>& columns, const std::vector<PeerMask::Ball>& robots = {},
            const Eigen::Vector3d& from = kSensor, const Eigen::Vector3d& error = Eigen::Vector3d::Zero()) {
    utime += 100ms;
    sogm_swarm::lidar_scan_t scan = column_scan(from, columns);
    Eigen::Map<Eigen::Vector3d>(scan.position) += error;
    scan.header.utime = to_us(utime);
    read_scan({scan}, config_.scan, config_.resolution_m, &scan_);
    perception.update(scan_, robots, scan.header);
  }
  // The same with a camera that looks along x.
  void look_ahead(const std::vector<Column>& columns, const Eigen::Vector3d& from, const Eigen::Vector3d& error) {
    utime += 100ms;
    sogm_swarm::depth_image_t image = column_image(from, columns);
    Eigen::Map<Eigen::Vector3d>(image.position) += error;
    image.header.utime = to_us(utime);
    read_scan(image, config_.scan, config_.resolution_m, &scan_);
    perception.update(scan_, {}, image.header);
  }
  // The column, wherever it goes.
  void follow(Column column, const Eigen::Vector2d& velocity, int scans, const std::vector<Column>& others = {}) {
    for (int i = 0; i < scans; ++i) {
      std::vector<Column> all = others;
      all.push_back(column);
      look(all);
      column.center += 0.1 * velocity;
    }
  }
  // The track nearest to a place, within half a metre.
  const Track* track_at(const Eigen::Vector2d& place) const {
    const Track* nearest = nullptr;
    double best_m = 0.5;
    for (const Track& track : perception.tracker().tracks()) {
      const double away_m = (track.obstacle.position.head<2>() - place).norm();
      if (away_m < best_m) best_m = away_m, nearest = &track;
    }
    return nearest;
  }
  // Anything within a voxel of the place; nothing: beams are further apart than voxels.
  bool stands(const Eigen::Vector3d& place) const { return count(0, place) > 0; }
  bool was_not_seen(const Eigen::Vector3d& place) const { return count(1, place) == 27; }

  Perception perception;
  Utime utime = kStart;

 private:
  int count(int frame, const Eigen::Vector3d& place) const {
    const Sogm& seen = perception.seen_space();
    const Eigen::Vector3i middle = seen.geometry.voxel_of(place);
    int set = 0;
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z) set += seen.occupied(frame, middle + Eigen::Vector3i(x, y, z)) ? 1 : 0;
    return set;
  }

  PerceptionConfig config_;
  RangeScan scan_;
};

TEST(Perception, FindsColumnsWhereTheyAreAndHowThick) {
  Looking looking;
  const std::vector<Column> columns = {{{2, 1}, 0.3}, {{-1.5, 3}, 0.15}, {{3, -3}, 0.5}};
  for (int i = 0; i < 5; ++i) looking.look(columns);
  ASSERT_EQ(looking.perception.tracker().tracks().size(), columns.size());
  for (const Column& column : columns) {
    SCOPED_TRACE(column.center.transpose());
    const Track* track = looking.track_at(column.center);
    ASSERT_NE(track, nullptr);
    EXPECT_LT((track->obstacle.position.head<2>() - column.center).norm(), 0.05);
    EXPECT_NEAR(track->obstacle.shape.size.x(), 2.0 * column.radius_m, 0.08);
    EXPECT_NEAR(track->obstacle.position.z() + track->obstacle.shape.size.y() / 2, column.top_m, 0.2);
    EXPECT_FALSE(looking.perception.is_moving(*track));
    const Eigen::Vector2d front = column.center * (1.0 - column.radius_m / column.center.norm());
    EXPECT_TRUE(looking.stands({front.x(), front.y(), 1.0}));
  }
}

TEST(Perception, KnowsWithinHalfASecondHowFastAColumnMoves) {
  for (const Eigen::Vector2d& velocity : {Eigen::Vector2d(0, 1), Eigen::Vector2d(-0.7, 0.2), Eigen::Vector2d(0.6, 0)}) {
    SCOPED_TRACE(velocity.transpose());
    PerceptionConfig knowing;
    knowing.explores = false;
    Looking looking(knowing);
    looking.follow({{2.5, -1}, 0.25}, velocity, 6);
    const Eigen::Vector2d place = Eigen::Vector2d(2.5, -1) + 0.5 * velocity;
    const Track* track = looking.track_at(place);
    ASSERT_NE(track, nullptr);
    EXPECT_LT((track->obstacle.velocity.head<2>() - velocity).norm(), 0.1);
    EXPECT_TRUE(looking.perception.is_moving(*track));
    // Its track draws it, also where it was seen a moment ago.
    EXPECT_FALSE(looking.stands({place.x() - 0.25, place.y(), 1.0}));
  }
}

// A LiDAR's at their first sight, a camera's at their second: its edges err.
TEST(Perception, WhereThereIsAMapSurfacesOfALidarStandAtOnce) {
  for (const bool is_lidar : {true, false}) {
    PerceptionConfig knowing;
    knowing.explores = false;
    Looking looking(knowing);
    const Column column{{2.0, 0.0}, 0.25};
    for (const bool again : {false, true}) {
      if (is_lidar)
        looking.look({column});
      else
        looking.look_ahead({column}, kSensor, Eigen::Vector3d::Zero());
      EXPECT_EQ(looking.stands({1.75, 0.05, 1.05}), is_lidar || again);
    }
  }
}

// Who was tracked before it moved far enough to be told of comes with a velocity; from then on with positions. Another
// who walks before it always hides one of its sides.
TEST(Perception, TheFirstReportTellsHowFast) {
  Looking looking;
  int reports = 0;
  for (int i = 0; i < 16; ++i) {
    const double y = -1.0 + 0.1 * i;
    looking.look({{{2.5, y}, 0.25}, {{1.25, 0.5 * y - 0.2}, 0.15}});
    for (const sogm_swarm::obstacle_t& obstacle : looking.perception.report().obstacles) {
      if (obstacle.position[0] < 2.0) continue;
      if (reports++ > 0) {
        EXPECT_EQ(obstacle.velocity_sigma, -1.0f) << i;
        continue;
      }
      EXPECT_LE(i, 10);
      EXPECT_GE(obstacle.velocity_sigma, 0.0f);
      EXPECT_NEAR(obstacle.velocity[1], 1.0, 0.4);
    }
  }
  EXPECT_GE(reports, 6);
}

// In a building: a pillar, or somebody who waits.
TEST(Perception, WhoStandsIsToldOfWhenItWalks) {
  Looking looking;
  const Column person{{2.5, 0.0}, 0.25};
  for (int i = 0; i < 50; ++i) {
    looking.look({person});
    EXPECT_TRUE(looking.perception.report().obstacles.empty()) << i;
    EXPECT_TRUE(i == 0 || looking.stands({2.25, 0.0, 1.0})) << i;
  }
  looking.follow(person, {0.0, 0.8}, 7);
  ASSERT_EQ(looking.perception.report().obstacles.size(), 1u);
  const Track* track = looking.track_at({2.5, 0.48});
  ASSERT_NE(track, nullptr);
  EXPECT_TRUE(looking.perception.is_moving(*track));
  EXPECT_NEAR(track->obstacle.velocity.y(), 0.8, 0.2);
}

// A robot flies along walls with a door between, and errs about where it is: nothing moves, and no door closes.
TEST(Perception, WallsStandAlsoWherePosesErr) {
  std::vector<Column> walls;
  for (double x = -5.0; x <= 5.0; x += 0.03)
    if (std::abs(x - 1.0) > 0.5) walls.push_back({{x, 1.5}, 0.02});
  for (double y = -2.0; y <= 1.5; y += 0.03) walls.push_back({{4.0, y}, 0.02});
  for (const bool by_camera : {false, true}) {
    SCOPED_TRACE(by_camera);
    Looking looking;
    int told = 0;
    for (int i = 0; i < 80; ++i) {
      const double t_s = 0.1 * i;
      const Eigen::Vector3d at(-2.0 + 0.5 * t_s, 0.1, 1.05);
      const Eigen::Vector3d error(0.03 * std::sin(0.7 * t_s), 0.04 * std::cos(1.1 * t_s), 0.0);
      if (by_camera) {
        looking.look_ahead(walls, at, error);
      } else {
        looking.look(walls, {}, at, error);
      }
      told += static_cast<int>(looking.perception.report().obstacles.size());
    }
    EXPECT_LE(told, 10) << "in 80 scans";
    EXPECT_TRUE(looking.stands({2.5, 1.5, 1.0}));
    EXPECT_TRUE(looking.stands({4.0, 0.0, 1.0}));
    EXPECT_FALSE(looking.stands({1.0, 1.5, 1.0}));
  }
}

TEST(Perception, TellsColumnsApartThatTouch) {
  Looking looking;
  looking.follow({{2.5, -1.5}, 0.3}, {0, 1.0}, 16, {{{2.5, 0.6}, 0.3}});  // ends 1 cm into the one that stands
  const Track* moving = looking.track_at({2.5, 0.0});
  const Track* standing = looking.track_at({2.5, 0.6});
  ASSERT_NE(moving, nullptr);
  ASSERT_NE(standing, nullptr);
  EXPECT_NE(moving->id, standing->id);
  EXPECT_NEAR(moving->obstacle.velocity.y(), 1.0, 0.15);
  EXPECT_LT(standing->obstacle.velocity.norm(), 0.15);
}

TEST(Perception, FindsColumnsThatWereNeverSeenApart) {
  Looking looking;
  const std::vector<Column> columns = {{{2.5, -0.9}, 0.45}, {{2.4, 0.0}, 0.45}, {{2.6, 0.9}, 0.45}};
  for (int i = 0; i < 3; ++i) looking.look(columns);
  for (const Column& column : columns) {
    const Track* track = looking.track_at(column.center);
    ASSERT_NE(track, nullptr) << column.center.transpose();
    EXPECT_LT((track->obstacle.position.head<2>() - column.center).norm(), 0.1) << column.center.transpose();
  }
}

TEST(Perception, WhatIsNotSeenToEndMayGoOn) {
  Looking looking;
  for (int i = 0; i < 3; ++i) looking.look({{{1.5, 0}, 0.3, -5.0, 9.0}});  // out of sight above and below
  const Track* track = looking.track_at({1.5, 0});
  ASSERT_NE(track, nullptr);
  const GridGeometry& window = looking.perception.grid().geometry();
  const double top_m = track->obstacle.position.z() + track->obstacle.shape.size.y() / 2;
  EXPECT_NEAR(top_m, window.resolution_m * (window.origin.z() + window.size.z()), 1e-6);
  EXPECT_NEAR(top_m - track->obstacle.shape.size.y(), window.resolution_m * window.origin.z(), 1e-6);
}

TEST(Perception, AWallIsNoTrack) {
  Looking looking;
  std::vector<Column> wall;  // of thin posts side by side
  for (double y = -3.0; y <= 3.0; y += 0.03) wall.push_back({{2.0, y}, 0.02});
  for (int i = 0; i < 15; ++i) looking.look(wall);
  EXPECT_TRUE(looking.stands({2.0, 0.0, 1.0}));
  for (const Track& track : looking.perception.tracker().tracks()) {
    EXPECT_FALSE(moves(track));
    EXPECT_GT(std::abs(track.obstacle.position.y()), 2.0) << "but at its ends, which may be columns";
  }
}

// A wall of columns, and something else that is not round either; neither was seen to move.
TEST(Perception, WhoKnowsTheMapTellsOfAllElseAtOnce) {
  std::vector<Column> wall, thing;
  for (int i = 0; i < 60; ++i) wall.push_back({{3.0, -3.0 + 0.1 * i}, 0.08, 0.0, 2.5});
  for (int i = 0; i < 5; ++i) thing.push_back({{1.5, -0.2 + 0.1 * i}, 0.04, 0.0, 1.8});
  std::vector<Column> all = wall;
  all.insert(all.end(), thing.begin(), thing.end());
  const TemporaryDirectory directory("perception_test");
  octomap::OcTree tree(0.1);
  for (int i = 0; i < 62; ++i)
    for (int z = 0; z < 25; ++z)
      tree.updateNode(
          octomap::point3d(2.95f, -3.05f + 0.1f * static_cast<float>(i), 0.05f + 0.1f * static_cast<float>(z)), true);
  const std::string map = (directory / "wall.bt").string();
  ASSERT_TRUE(tree.writeBinary(map));

  PerceptionConfig knowing, exploring;
  knowing.explores = false;
  knowing.static_map = map;
  Looking knows(knowing), explores(exploring);
  for (int i = 0; i < 15; ++i) knows.look(all), explores.look(all);
  EXPECT_GE(knows.perception.report().num_obstacles, 1);
  for (const sogm_swarm::obstacle_t& obstacle : knows.perception.report().obstacles)
    EXPECT_NEAR(obstacle.position[0], 1.5, 0.4) << "the wall is none";
  EXPECT_TRUE(knows.stands({2.95, 2.5, 1.0})) << "but it stands";
  EXPECT_GT(knows.perception.points(), 500) << "and its points count";
  EXPECT_EQ(explores.perception.report().num_obstacles, 0);
  EXPECT_TRUE(explores.stands({1.5, 0.0, 1.0}));
}

TEST(Perception, WhoExploresTakesALidarAtItsWordAndNoCamera) {
  std::vector<Column> wall;
  for (double y = -1.0; y <= 1.0; y += 0.03) wall.push_back({{3.03, y}, 0.02});  // at the front of voxels
  const Eigen::Vector3d place(3.03, 0.0, 1.0), no_error = Eigen::Vector3d::Zero();
  Looking by_lidar, by_camera;
  by_lidar.look(wall);
  EXPECT_TRUE(by_lidar.stands(place));
  by_camera.look_ahead(wall, kSensor, no_error);
  EXPECT_FALSE(by_camera.stands(place));
  by_camera.look_ahead(wall, kSensor, no_error);
  EXPECT_TRUE(by_camera.stands(place));
  Looking alone;  // at edges rays mix what is before them with what is behind
  const std::vector<Column> wire = {{{3.03, kSensor.y()}, 0.004}};  // beams meet it far apart
  alone.look(wire);
  EXPECT_FALSE(alone.stands(place));
  alone.look(wire);
  EXPECT_TRUE(alone.stands(place));
}

TEST(Perception, SomebodyWhoComesOutOfAWallIsTracked) {
  Looking looking;
  std::vector<Column> wall;
  for (double y = -3.0; y <= 3.0; y += 0.03) wall.push_back({{3.0, y}, 0.02});
  for (int i = 0; i < 15; ++i) looking.look(wall);
  looking.follow({{3.0, 0.5}, 0.25}, {-0.8, 0}, 12, wall);
  const Track* track = looking.track_at({3.0 - 0.8 * 1.1, 0.5});
  ASSERT_NE(track, nullptr);
  EXPECT_NEAR(track->obstacle.velocity.x(), -0.8, 0.15);
}

TEST(Perception, RobotsAreNoObstacles) {
  Looking looking;
  const Column robot{{2.0, 0.0}, 0.2, 0.8, 1.2};
  for (int i = 0; i < 3; ++i) looking.look({robot}, {{{2.0, 0.0, 1.0}, 0.35}});
  EXPECT_GT(looking.perception.masked(), 0);
  EXPECT_TRUE(looking.perception.tracker().tracks().empty());
  EXPECT_FALSE(looking.stands({1.8, 0.0, 1.0}));
  for (int i = 0; i < 3; ++i) looking.look({robot});  // nobody says that it is one
  EXPECT_EQ(looking.perception.masked(), 0);
  EXPECT_NE(looking.track_at({2.0, 0.0}), nullptr);
}

TEST(Perception, WhatWasNotSeenIsUnknown) {
  Looking looking;
  looking.look({{{2, 0}, 0.4, -5.0, 9.0}});
  EXPECT_FALSE(looking.was_not_seen({1.0, 0.0, 1.05}));  // before it
  EXPECT_FALSE(looking.was_not_seen({1.6, 0.0, 1.05}));  // its surface
  EXPECT_TRUE(looking.was_not_seen({3.5, 0.0, 1.05}));   // behind
  EXPECT_TRUE(looking.was_not_seen({0.2, 0.0, 2.5}));    // above the beams
  EXPECT_FALSE(looking.was_not_seen({-3.0, 1.0, 1.05}));
}

// Where the robot is nothing else is, nor around where it was put; what it knows close by it does not forget.
TEST(Perception, TheRobotsOwnPlaceIsFree) {
  Looking looking;
  looking.look({});
  const Eigen::Vector3d above = kSensor + Eigen::Vector3d(0, 0, 0.3);
  EXPECT_FALSE(looking.was_not_seen(above));
  EXPECT_TRUE(looking.was_not_seen(kSensor + Eigen::Vector3d(0, 0, 0.9)));
  for (int i = 0; i < 200; ++i) looking.look({});
  EXPECT_FALSE(looking.was_not_seen(kSensor + Eigen::Vector3d(0, 0, 0.4)))
      << "nobody looked there since, but it is near";
  const Eigen::Vector3d next = kSensor + Eigen::Vector3d(0, 0, 2.0);
  looking.look({}, {}, next);
  EXPECT_FALSE(looking.was_not_seen(next + Eigen::Vector3d(0, 0, 0.2)));
  EXPECT_TRUE(looking.was_not_seen(next + Eigen::Vector3d(0, 0, 0.7)));
  const Eigen::Vector3d begun = kSensor + Eigen::Vector3d(0, 0, 0.3);
  EXPECT_FALSE(looking.was_not_seen(begun));
  for (int i = 0; i < 200; ++i) looking.look({}, {}, next);
  EXPECT_TRUE(looking.was_not_seen(begun)) << "too long ago, and far away";
  EXPECT_FALSE(looking.was_not_seen(next + Eigen::Vector3d(0, 0, 0.2)));
}

// It may turn where nobody sees it. (map_daemon goes on to draw it for longer.)
TEST(Perception, WhoGoesOutOfSightIsTrackedForAMomentOnly) {
  Looking looking;
  looking.follow({{2.5, -1}, 0.25}, {0, 0.6}, 12);
  ASSERT_EQ(looking.perception.tracker().tracks().size(), 1u);
  for (int tenths_unseen = 1; tenths_unseen <= 9; ++tenths_unseen) {
    looking.look({});
    EXPECT_EQ(looking.perception.tracker().tracks().empty(), tenths_unseen > 6) << tenths_unseen;
  }
}

TEST(Perception, ForgetsAllWhenItIsLost) {
  Looking looking;
  for (int i = 0; i < 3; ++i) looking.look({{{2, 0}, 0.4}});
  looking.perception.forget();
  EXPECT_TRUE(looking.perception.tracker().tracks().empty());
  looking.look({});
  EXPECT_FALSE(looking.stands({1.6, 0.0, 1.0}));
}

// The same scans give the same messages.
TEST(Perception, IsDeterministic) {
  Looking first, second;
  for (Looking* looking : {&first, &second}) looking->follow({{2.5, -1}, 0.25}, {0, 0.6}, 12, {{{2.6, 0.3}, 0.4}});
  EXPECT_EQ(first.perception.seen_space().words(), second.perception.seen_space().words());
  std::vector<std::uint8_t> one, other;
  encode(first.perception.report(), &one);
  encode(second.perception.report(), &other);
  EXPECT_EQ(one, other);
}

}  // namespace
}  // namespace swarm::test
