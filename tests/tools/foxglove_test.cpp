// Foxglove's messages: what is built fits the schema that goes with it and says what was meant.
#include "tools/logs/foxglove.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/json_schema.h"
#include "tests/support/start_time.h"

namespace swarm::foxglove {
namespace {

using Eigen::Vector3d;
using swarm::test::misfit;

std::string encoded(const std::string& text) {
  return base64({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

TEST(Foxglove, Base64IsTheStandardOne) {
  const std::pair<const char*, const char*> known[] = {{"", ""},
                                                       {"f", "Zg=="},
                                                       {"fo", "Zm8="},
                                                       {"foo", "Zm9v"},
                                                       {"foob", "Zm9vYg=="},
                                                       {"fooba", "Zm9vYmE="},
                                                       {"foobar", "Zm9vYmFy"},
                                                       {"\xfb\xff\xfe", "+//+"}};
  for (const auto& [text, expected] : known) EXPECT_EQ(encoded(text), expected);
}

TEST(Foxglove, ScenesFitTheirSchema) {
  Json thing = entity(kStart + 123'456us, "thing", "robot3", 1500ms);
  const Color color = {0.1, 0.2, 0.3, 0.4};
  const Pose pose = {{1, 2, 3}, 0.5};
  const Vector3d points[] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  thing["cubes"].push_back(cube(pose, {1, 2, 3}, color));
  thing["spheres"].push_back(sphere(pose, 0.4, color));
  thing["cylinders"].push_back(cylinder(pose, 0.4, 2.0, color));
  thing["lines"].push_back(line(pose, points, true, 0.1, color));
  const std::vector<Vector3d> polygon(std::begin(points), std::end(points));
  thing["triangles"].push_back(polygons(std::vector{polygon, {}, polygon}, color));
  EXPECT_EQ(thing["timestamp"].dump(), R"({"sec":1700000000,"nsec":123456000})");
  EXPECT_EQ(thing["lifetime"].dump(), R"({"sec":1,"nsec":500000000})");
  EXPECT_EQ(thing["frame_locked"], true);
  EXPECT_EQ(entity(kStart, "thing")["frame_locked"], false);
  EXPECT_EQ(thing["spheres"][0]["size"].dump(), R"({"x":0.4,"y":0.4,"z":0.4})");
  EXPECT_EQ(thing["cylinders"][0]["size"].dump(), R"({"x":0.4,"y":0.4,"z":2.0})");
  EXPECT_EQ(thing["lines"][0]["type"], 1) << "a loop";
  EXPECT_EQ(thing["triangles"][0]["points"].size(), 8u);
  EXPECT_EQ(thing["triangles"][0]["indices"].dump(), "[0,1,2,0,2,3,4,5,6,4,6,7]");
  const Json all = scene(Json::array({thing}), Json::array({deletion(kStart, "other")}));
  EXPECT_EQ(misfit(schema(kSceneUpdate), all), "");
}

TEST(Foxglove, TransformsFitTheirSchema) {
  const Json all = {{"transforms", Json::array({transform(kStart, "world", "robot1", {{1, 2, 3}, M_PI / 2})})}};
  EXPECT_EQ(misfit(schema(kFrameTransforms), all), "");
  const Json& rotation = all["transforms"][0]["rotation"];
  EXPECT_NEAR(rotation["z"].get<double>(), std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(rotation["w"].get<double>(), std::sqrt(0.5), 1e-12);
  EXPECT_EQ(rotation["x"], 0.0);
  EXPECT_EQ(all["transforms"][0]["translation"].dump(), R"({"x":1.0,"y":2.0,"z":3.0})");
}

TEST(Foxglove, PointCloudsFitTheirSchema) {
  const Eigen::Vector4f points[] = {{1, -2, 3, 0.5f}, {4, 5, 6, 7}};
  const Json cloud = point_cloud(kStart, points);
  EXPECT_EQ(misfit(schema(kPointCloud), cloud), "");
  EXPECT_EQ(cloud["point_stride"], 16);
  EXPECT_EQ(cloud["fields"][3].dump(), R"({"name":"t","offset":12,"type":7})");
  // 1.0f and -2.0f are 00 00 80 3f and 00 00 00 c0 in memory.
  EXPECT_EQ(cloud["data"].get<std::string>().substr(0, 10), "AACAPwAAAM");
  EXPECT_EQ(cloud["data"].get<std::string>().size(), 44u);
}

TEST(Foxglove, SchemasAreReadByViewers) {
  for (const char* name : {kSceneUpdate, kFrameTransforms, kPointCloud}) {
    EXPECT_EQ(swarm::test::unreadable(schema(name)), "");
    EXPECT_EQ(schema(name).at("title"), name);
  }
}

TEST(Foxglove, OtherSchemasAreRefused) {
  EXPECT_THROW((void)schema("foxglove.Log"), std::invalid_argument);
}

}  // namespace
}  // namespace swarm::foxglove
