#include "tools/viewer/picture_frame.h"

#include <random>

#include "tests/support/harness.h"
#include "tests/support/view_frame.h"
#include "tools/logs/polytope_faces.h"
#include "tools/logs/sogm_surface.h"

namespace swarm::test {
namespace {

ViewFrame frame_of(const Json& text, const FrameWriter& writer) {
  std::vector<std::uint8_t> bytes;
  writer.finish(text, &bytes);
  return ViewFrame(std::string(bytes.begin(), bytes.end()));
}

TEST(PictureFrame, ArraysAreReadAsTheyWereWritten) {
  for (std::size_t length = 0; length < 9; ++length) {
    FrameWriter writer;
    std::vector<float> floats(length, 1.5f);
    std::vector<std::int16_t> shorts(length, -7);
    Json text = {{"pad", std::string(length, 'x')}, {"name", "a\xff"}};  // not UTF-8: replaced
    text["shorts"] = writer.array(std::span<const std::int16_t>(shorts));
    text["floats"] = writer.array(std::span<const float>(floats));
    const ViewFrame frame = frame_of(text, writer);
    EXPECT_EQ(frame.numbers<float>(frame.text["floats"]), floats);
    EXPECT_EQ(frame.numbers<std::int16_t>(frame.text["shorts"]), shorts);
    writer.clear();
    EXPECT_EQ(frame_of({}, writer).arrays, "");
  }
}

TEST(PictureFrame, SogmIsItsSurface) {
  Sogm sogm;
  GridGeometry geometry;
  geometry.size = {12, 10, 70};
  geometry.origin = {-5, 3, 0};
  sogm.reset(geometry, 4, kStart, 100ms);
  std::mt19937 random(1);
  for (int i = 0; i < 3000; ++i) {
    const int z = static_cast<int>(random() % 70);
    sogm.column(static_cast<int>(random() % 4), static_cast<int>(random() % 12),
                static_cast<int>(random() % 10))[z / 64] |= std::uint64_t{1} << (z % 64);
  }
  for (int shown = -1; shown <= 4; ++shown) {
    FrameWriter writer;
    const Json text = sogm_json(sogm, shown, &writer);
    const ViewFrame frame = frame_of(text, writer);
    std::vector<SurfaceVoxel> surface;
    sogm_surface(sogm, shown, &surface);
    std::vector<std::int16_t> expected;
    for (const SurfaceVoxel& voxel : surface)
      expected.insert(expected.end(), {voxel.x, voxel.y, voxel.z, voxel.first_frame});
    EXPECT_EQ(frame.numbers<std::int16_t>(frame.text["voxels"]), expected);
    EXPECT_EQ(expected.empty(), shown == 4) << "there is no such frame";
    EXPECT_EQ(frame.text["origin"], WebJson({-5, 3, 0}));
  }
}

TEST(PictureFrame, CorridorsAreTheirFacesAndEdges) {
  RobotPicture robot;
  sogm_swarm::corridors_t corridors{};
  for (std::int16_t piece = 0; piece < 2; ++piece) {  // cubes of 2 m around (4 piece, 0, 0)
    for (int axis = 0; axis < 3; ++axis) {
      for (const float side : {-1.0f, 1.0f}) {
        sogm_swarm::face_t face{};
        face.piece = piece;
        face.normal[axis] = side;
        face.offset = 1.0f + (axis == 0 ? side * 4.0f * static_cast<float>(piece) : 0.0f);
        corridors.faces.push_back(face);
      }
    }
  }
  corridors.num_faces = static_cast<std::int32_t>(corridors.faces.size());
  robot.corridors = corridors;
  FrameWriter writer;
  const Json text = corridors_json(robot, &writer);
  const ViewFrame frame = frame_of(text, writer);
  EXPECT_EQ(frame.text["pieces"], 2);
  const auto triangles = frame.numbers<float>(frame.text["triangles"]);
  const auto edges = frame.numbers<float>(frame.text["edges"]);
  EXPECT_EQ(triangles.size(), 2u * 6 * 2 * 9);
  EXPECT_EQ(edges.size(), 2u * 6 * 4 * 6);
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const float middle = i % 3 == 0 && i >= triangles.size() / 2 ? 4.0f : 0.0f;
    EXPECT_NEAR(std::abs(triangles[i] - middle), 1.0f, 1e-5f) << i;
  }
}

}  // namespace
}  // namespace swarm::test
