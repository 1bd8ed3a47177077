// Faces of polytopes: known ones, and random ones whose polygons must enclose what their half-spaces do.
#include "tools/logs/polytope_faces.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "tests/support/random_motion.h"

namespace swarm {
namespace {

using Eigen::Vector3d;

std::vector<HalfSpace> box(const Vector3d& low, const Vector3d& high) {
  std::vector<HalfSpace> half_spaces;
  for (int axis = 0; axis < 3; ++axis) {
    half_spaces.push_back({Vector3d::Unit(axis), high[axis]});
    half_spaces.push_back({-Vector3d::Unit(axis), -low[axis]});
  }
  return half_spaces;
}

Vector3d area_vector(const Polygon& polygon) {
  Vector3d sum = Vector3d::Zero();
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i)
    sum += 0.5 * (polygon[i] - polygon[0]).cross(polygon[i + 1] - polygon[0]);
  return sum;
}

// By the divergence theorem.
double volume(const std::vector<Polygon>& faces) {
  double sum = 0.0;
  for (const Polygon& face : faces) {
    if (!face.empty()) sum += area_vector(face).dot(face[0]) / 3.0;
  }
  return sum;
}

bool inside(const std::vector<HalfSpace>& half_spaces, const Vector3d& p) {
  return std::ranges::all_of(half_spaces, [&](const HalfSpace& h) { return h.normal.dot(p) <= h.offset; });
}

TEST(PolytopeFaces, OfABoxAreItsSixSides) {
  const Vector3d low(-1, 2, 3), high(1, 5, 7);
  const auto faces = polytope_faces(box(low, high), {40, -30, 20}, 1000.0);
  const double areas[] = {12, 12, 8, 8, 6, 6};
  ASSERT_EQ(faces.size(), 6u);
  for (std::size_t i = 0; i < faces.size(); ++i) {
    EXPECT_EQ(faces[i].size(), 4u);
    EXPECT_NEAR(area_vector(faces[i]).dot(box(low, high)[i].normal), areas[i], 1e-9) << i;
    for (const Vector3d& corner : faces[i]) {
      for (int axis = 0; axis < 3; ++axis)
        EXPECT_LT(std::min(std::abs(corner[axis] - low[axis]), std::abs(corner[axis] - high[axis])), 1e-9);
    }
  }
}

TEST(PolytopeFaces, OfRandomPolytopesEncloseThem) {
  Rng rng(11);
  for (int trial = 0; trial < 100; ++trial) {
    SCOPED_TRACE(trial);
    const Vector3d middle = in_cube(rng, 50.0);
    std::vector<HalfSpace> half_spaces = box(middle - Vector3d::Ones(), middle + Vector3d::Ones());
    for (int i = uniform_int(rng, 0, 30); i > 0; --i) {
      const Vector3d normal = direction(rng);
      half_spaces.push_back({normal, normal.dot(middle) + uniform(rng, 0.3, 2.0)});
    }
    const auto faces = polytope_faces(half_spaces, middle + in_cube(rng, 3.0), 20.0);
    ASSERT_EQ(faces.size(), half_spaces.size());
    Vector3d closed = Vector3d::Zero();
    for (std::size_t i = 0; i < faces.size(); ++i) {
      if (faces[i].empty()) continue;
      ASSERT_GE(faces[i].size(), 3u);
      EXPECT_GT(area_vector(faces[i]).dot(half_spaces[i].normal), 0.0);
      closed += area_vector(faces[i]);
      for (const Vector3d& corner : faces[i]) {
        EXPECT_NEAR(half_spaces[i].normal.dot(corner), half_spaces[i].offset, 1e-7);
        for (const HalfSpace& other : half_spaces) EXPECT_LT(other.normal.dot(corner) - other.offset, 1e-7);
      }
    }
    EXPECT_LT(closed.norm(), 1e-5) << "the faces have a gap";
    // As many of random points of the box lie within the half-spaces as the enclosed volume says.
    constexpr int kPoints = 20'000;
    int hits = 0;
    for (int i = 0; i < kPoints; ++i) hits += inside(half_spaces, middle + in_cube(rng, 1.0));
    EXPECT_NEAR(volume(faces), 8.0 * hits / kPoints, 0.15);
  }
}

TEST(PolytopeFaces, WhatBoundsNothingHasNone) {
  auto half_spaces = box({0, 0, 0}, {1, 1, 1});
  half_spaces.push_back(half_spaces[2]);                                  // a second time
  half_spaces.push_back({{1, 0, 0}, 5.0});                                // far away
  half_spaces.push_back({Vector3d(1, 1, 0).normalized(), std::sqrt(2)});  // touches an edge
  half_spaces.push_back({Vector3d(1, 1, 1).normalized(), std::sqrt(3)});  // touches a corner
  half_spaces.push_back({{0, 0, 0}, -1.0});                               // no direction
  const auto faces = polytope_faces(half_spaces, {0.5, 0.5, 0.5}, 10.0);
  for (std::size_t i = 0; i < faces.size(); ++i) EXPECT_EQ(faces[i].size(), i < 6 ? 4u : 0u) << i;
  EXPECT_NEAR(volume(faces), 1.0, 1e-9);
}

TEST(PolytopeFaces, EmptyPolytopesHaveNone) {
  auto half_spaces = box({0, 0, 0}, {1, 1, 1});
  half_spaces.push_back({{1, 0, 0}, -1.0});
  for (const Polygon& face : polytope_faces(half_spaces, {0, 0, 0}, 10.0)) EXPECT_TRUE(face.empty());
  EXPECT_TRUE(polytope_faces({}, {0, 0, 0}, 10.0).empty());
}

TEST(PolytopeFaces, WithoutBoundsAreCutOff) {
  const std::vector<HalfSpace> floor = {{{0, 0, -2}, 0.0}};  // of any length
  const auto faces = polytope_faces(floor, {3, 4, 5}, 10.0);
  ASSERT_EQ(faces[0].size(), 4u);
  EXPECT_NEAR(area_vector(faces[0]).z(), -400.0, 1e-9);
  for (const Vector3d& corner : faces[0]) EXPECT_LT((corner - Vector3d(3, 4, 0)).norm(), 14.2);
}

TEST(PolytopeFaces, MessagesAreSplitIntoTheirPieces) {
  sogm_swarm::corridors_t message{};
  for (const int piece : {4, 0, 4}) {
    sogm_swarm::face_t face{};
    face.piece = static_cast<std::int16_t>(piece);
    face.normal[1] = 1.0f;
    face.offset = static_cast<float>(message.faces.size());
    message.faces.push_back(face);
  }
  message.num_faces = 3;
  const auto pieces = corridor_pieces(message);
  ASSERT_EQ(pieces.size(), 2u);
  EXPECT_EQ(pieces[0].piece, 0);
  EXPECT_EQ(pieces[1].piece, 4);
  ASSERT_EQ(pieces[0].half_spaces.size(), 1u);
  ASSERT_EQ(pieces[1].half_spaces.size(), 2u);
  EXPECT_EQ(pieces[1].half_spaces[1].offset, 2.0);
  EXPECT_EQ(pieces[1].half_spaces[1].normal, Vector3d(0, 1, 0));
}

}  // namespace
}  // namespace swarm
