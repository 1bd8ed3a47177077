// Recorded scans: files as others write them, files that are damaged, and what is played of them.
#include "tools/scans/scan_player.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/temporary_directory.h"
#include "tests/support/harness.h"
#include "tools/scans/point_cloud_file.h"

namespace swarm::test {
namespace {

using sogm_swarm::lidar_scan_t;
using sogm_swarm::robot_state_t;

template <class... Values>
std::string raw(const Values&... values) {
  std::string bytes;
  const auto add = [&](const auto& value) { bytes.append(reinterpret_cast<const char*>(&value), sizeof value); };
  (add(values), ...);
  return bytes;
}

// What a call complains of.
template <class Call>
std::string complaint(const Call& call) {
  try {
    call();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "nothing";
}

class ScanFiles : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& bytes) {
    write_text(directory_ / name, bytes);
    return directory_ / name;
  }
  std::filesystem::path write_points(const std::string& name, const std::vector<Eigen::Vector3f>& points) {
    std::string bytes;
    for (const Eigen::Vector3f& point : points) bytes += raw(point.x(), point.y(), point.z(), 0.5f);
    return write(name, bytes);
  }
  void expect_complaint(const std::string& name, const std::string& bytes, const std::vector<std::string>& texts) {
    const std::filesystem::path path = write(name, bytes);
    const std::string said = complaint([&] { (void)read_point_cloud(path); });
    EXPECT_NE(said.find(path.string()), std::string::npos) << said;
    for (const std::string& text : texts) EXPECT_NE(said.find(text), std::string::npos) << text << " in: " << said;
  }

  TemporaryDirectory directory_;
};

const std::string kHeader =
    "# .PCD v0.7\nVERSION 0.7\nFIELDS intensity x y z ring\nSIZE 4 4 4 8 2\nTYPE F F F F U\nCOUNT 1 1 1 1 3\n"
    "WIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA ";

TEST_F(ScanFiles, PointsAreReadWhateverIsBesideThem) {
  const std::vector<Eigen::Vector3d> expected = {{1.5, -2.25, 0.125}, {100.0, 0.5, -3.0}};
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr std::uint16_t kRing[3] = {1, 2, 3};
  const auto point = [&](float x, float y, double z) { return raw(7.0f, x, y, z, kRing); };
  EXPECT_EQ(read_point_cloud(
                write("a.pcd", kHeader + "ascii\n9 1.5 -2.25 0.125 1 2 3\n9 nan nan nan 1 2 3\n9 1e2 .5 -3 0 0 0\n")),
            expected);
  EXPECT_EQ(read_point_cloud(write("b.pcd", kHeader + "binary\n" + point(1.5f, -2.25f, 0.125) + point(kNan, 0.0f, 0.0) +
                                                point(100.0f, 0.5f, -3.0))),
            expected);
  EXPECT_EQ(read_point_cloud(write_points("c.bin", {{1.5f, -2.25f, 0.125f}, {100.0f, 0.5f, -3.0f}})), expected);
  EXPECT_TRUE(read_point_cloud(write("d.bin", "")).empty());
  EXPECT_EQ(read_point_cloud(write(
                "e.pcd", "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 1\nDATA binary\n" + raw(1.0f, 2.0f, 3.0f))),
            (std::vector<Eigen::Vector3d>{{1, 2, 3}}));
}

TEST_F(ScanFiles, DamagedFilesAreRefusedByName) {
  EXPECT_NE(complaint([&] { (void)read_point_cloud(directory_ / "none.pcd"); }).find("readable file"),
            std::string::npos);
  expect_complaint("a.bin", "12345", {"5 bytes", "multiple of 16"});
  expect_complaint("a.ply", "ply", {".pcd or .bin"});
  expect_complaint("a.pcd", "hello\n", {"no line DATA"});
  expect_complaint("a.pcd", kHeader + "binary_compressed\n", {"binary_compressed", "ascii or binary"});
  expect_complaint("a.pcd", kHeader + "binary\nabc", {"ends after 0 of its 3 points"});
  expect_complaint("a.pcd", kHeader + "ascii\n9 1 2 3 1 2 3\n", {"ends after 1 of its 3 points"});
  expect_complaint("a.pcd", kHeader + "ascii\n9 1 2 3 1 2\n", {"point 0", "6 numbers, not 7"});
  expect_complaint("a.pcd", kHeader + "ascii\n9 1 two 3 1 2 3\n", {"point 0", "'two'"});
  expect_complaint("a.pcd", replaced(kHeader, "POINTS 3", "POINTS -3") + "ascii\n", {"POINTS -3"});
  expect_complaint("a.pcd", replaced(kHeader, "POINTS 3", "POINTS 99999999999999999999") + "binary\n", {"POINTS 9999"});
  expect_complaint("a.pcd", replaced(kHeader, "POINTS 3", "POINTS 250000000") + "binary\nabc", {"ends after 0"});
  expect_complaint("a.pcd", replaced(kHeader, "intensity x y", "intensity x w") + "ascii\n", {"no field y"});
  expect_complaint("a.pcd", replaced(kHeader, "TYPE F F", "TYPE F I") + "ascii\n", {"field x", "TYPE F"});
  expect_complaint("a.pcd", replaced(kHeader, "SIZE 4 4 4 8 2", "SIZE 4 4 4") + "ascii\n", {"FIELDS, SIZE"});
}

TEST_F(ScanFiles, PosesAreFoundBetweenThoseThatAreThere) {
  const double half = std::sqrt(0.5);
  const PoseTrack track(write("poses.txt", "# t x y z qx qy qz qw\n\n10 0 0 1 0 0 0 1\n12 4 2 1 0 0 " +
                                               std::to_string(half) + " " + std::to_string(half) + "\r\n"));
  EXPECT_EQ(track.begin_s(), 10.0);
  EXPECT_EQ(track.end_s(), 12.0);
  EXPECT_LT((track.at(10.5).position - Eigen::Vector3d(1.0, 0.5, 1.0)).norm(), 1e-12);
  const auto turned = [&](double t_s) {
    return track.at(t_s).orientation.angularDistance(Eigen::Quaterniond::Identity());
  };
  EXPECT_NEAR(turned(11.0), M_PI / 4, 1e-6);
  EXPECT_NEAR(turned(10.5), M_PI / 8, 0.02);  // the rate is nearly constant
  EXPECT_LT((track.at(12.0).position - Eigen::Vector3d(4, 2, 1)).norm(), 1e-12);
  EXPECT_LT((track.at(99.0).position - Eigen::Vector3d(4, 2, 1)).norm(), 1e-12);
  EXPECT_LT((track.velocity_at(11.0) - Eigen::Vector3d(2, 1, 0)).norm(), 1e-12);
  EXPECT_EQ(track.velocity_at(13.0), Eigen::Vector3d(0, 0, 0));
  const auto complaint_of = [&](const std::string& text) {
    return complaint([&] { PoseTrack(write("bad.txt", text)); });
  };
  const std::string good = "1 0 0 0 0 0 0 1\n";
  EXPECT_NE(complaint_of(good).find("two poses"), std::string::npos);
  EXPECT_NE(complaint_of(good + "2 0 0 0 0 0 0\n").find("bad.txt:2: must be 't x y z qx qy qz qw'"), std::string::npos);
  EXPECT_NE(complaint_of(good + "2 0 0 0 0 0 0 1 7\n").find("bad.txt:2: '7'"), std::string::npos);
  EXPECT_NE(complaint_of(good + "2 0 0 0 0 0 0 1.5\n").find("length is 1.5"), std::string::npos);
  EXPECT_NE(complaint_of(good + "2 0 0 1e9 0 0 0 1\n").find("within 1e5 m"), std::string::npos);
  EXPECT_NE(complaint_of(good + good).find("bad.txt:2: time 1.0"), std::string::npos);
}

TEST_F(ScanFiles, ScansHaveTimesByTheirNamesOrByAList) {
  const std::filesystem::path scans = directory_ / "scans";
  const auto complaint_of = [&](const std::filesystem::path& times) {
    return complaint([&] { (void)list_scans(scans, times); });
  };
  EXPECT_NE(complaint_of("").find("readable directory"), std::string::npos);
  std::filesystem::create_directory(scans);
  EXPECT_NE(complaint_of("").find("must have files"), std::string::npos);
  for (const char* name : {"9.5.bin", "10.25.bin", "notes.txt"}) write(std::string("scans/") + name, "");
  const std::vector<RecordedScan> named = list_scans(scans, "");
  ASSERT_EQ(named.size(), 2u);
  EXPECT_EQ(named[0].t_s, 9.5);
  EXPECT_EQ(named[1].t_s, 10.25);
  EXPECT_EQ(list_scans(scans, write("times.txt", "1.5\n2.5\n"))[1].file.filename(), "9.5.bin");
  EXPECT_NE(complaint_of(write("times.txt", "1.5\n")).find("has 1 times"), std::string::npos);
  EXPECT_NE(complaint_of(write("times.txt", "1.5 x")).find("time 1: 'x'"), std::string::npos);
  EXPECT_NE(complaint_of(write("times.txt", "1.5 1.5")).find("must be later"), std::string::npos);
  write("scans/000003.bin", "");
  EXPECT_NE(complaint_of("").find("'000003' must be seconds with a decimal point, or say --times"), std::string::npos);
}

TEST_F(ScanFiles, ScansArePlayedWhenAndWhereTheyWereTaken) {
  std::filesystem::create_directory(directory_ / "scans");
  std::vector<Eigen::Vector3f> many(25'000, Eigen::Vector3f(1.0f, 2.0f, 3.0f));
  many.back() = {1000.0f, 500.0f, -10.0f};
  write_points("scans/100.0.bin", {{1.0f, -2.0f, 0.5024f}});
  write_points("scans/100.5.bin", many);
  write_points("scans/101.0.bin", std::vector<Eigen::Vector3f>(400'000, Eigen::Vector3f(1, 1, 1)));
  const double half = std::sqrt(0.5);
  const PoseTrack poses(write("poses.txt", "99 -1 0 1 0 0 0 1\n101 1 0 1 0 0 0 1\n102 1 0 1 0 0 " +
                                               std::to_string(half) + " " + std::to_string(half) + "\n"));
  ScanPlayerConfig config{.robot_id = 3, .sensor = 2, .speed = 2.0};
  Bench<ScanPlayer> player(config, list_scans(directory_ / "scans", ""), poses, 7);
  EXPECT_FALSE(player.node.is_over());
  player.run_for(0.3);
  const auto first = player.out.all<lidar_scan_t>(channel::kLidarScan);
  ASSERT_EQ(first.size(), 4u);
  EXPECT_EQ(first[0].header.utime, to_us(kStart));
  EXPECT_EQ(first[0].header.robot_id, 3);
  EXPECT_EQ(first[0].sensor, 2);
  EXPECT_EQ(first[0].position[0], 0.0);
  EXPECT_EQ(first[0].coordinates, (std::vector<std::int16_t>{200, -400, 100}));
  for (std::size_t part = 0; part < 3; ++part) {
    const lidar_scan_t& scan = first[1 + part];
    EXPECT_EQ(scan.header.utime, to_us(kStart + 250ms));
    EXPECT_EQ(scan.header.seq, 1);
    EXPECT_EQ(scan.part, static_cast<int>(part));
    EXPECT_EQ(scan.num_parts, 3);
    EXPECT_EQ(scan.num_coordinates, part < 2 ? 30'000 : 15'000);
    EXPECT_NEAR(scan.position[0], 0.5, 1e-12);
  }
  const std::vector<std::int16_t>& last = first[3].coordinates;
  EXPECT_EQ(std::vector<std::int16_t>(last.end() - 3, last.end()), (std::vector<std::int16_t>{32'000, 16'000, -320}))
      << "free up to there";
  const auto state = player.out.newest<robot_state_t>(channel::kRobotState);
  EXPECT_EQ(player.out.count(channel::kRobotState), 16);
  EXPECT_NEAR(state.position[0], 2.0 * to_seconds(to_utime(state.header.utime) - kStart), 1e-9);
  EXPECT_NEAR(state.velocity[0], 2.0, 1e-9) << "played twice as fast";

  player.run_for(0.3);
  EXPECT_TRUE(player.node.is_over());
  EXPECT_EQ(player.node.played(), 3u);
  EXPECT_EQ(player.node.thinned(), 1);
  EXPECT_EQ(player.node.points(), 1 + 25'000 + 133'334);
  EXPECT_EQ(player.node.late(), 0u);
  player.run_for(1.0);
  EXPECT_EQ(player.out.all<lidar_scan_t>(channel::kLidarScan).size(), 4u + 14u);

  const PoseTrack short_poses(write("short.txt", "99 0 0 1 0 0 0 1\n100.7 0 0 1 0 0 0 1\n"));
  const std::string said = complaint([&] { ScanPlayer(config, list_scans(directory_ / "scans", ""), short_poses, 7); });
  EXPECT_NE(said.find("101.0.bin: time 101"), std::string::npos) << said;
}

}  // namespace
}  // namespace swarm::test
