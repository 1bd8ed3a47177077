// Two maps compared, a map in letters, and the conversation with the daemon that is asked to write its own.
#include <gtest/gtest.h>
#include <octomap/OcTree.h>

#include "lcmtypes/bus/channels.h"
#include "tests/support/harness.h"
#include "tools/maps/map_comparison.h"
#include "tools/maps/map_picture.h"
#include "tools/maps/save_node.h"

namespace swarm::test {
namespace {

using sogm_swarm::perception_status_t;
using Progress = SaveNode::Progress;

// A wall along y at x, free space of a metre before it, one voxel high.
void add_wall(octomap::OcTree* tree, float x) {
  for (int i = 0; i < 20; ++i) {
    const float y = 0.05f + 0.1f * static_cast<float>(i);
    tree->updateNode(octomap::point3d(x, y, 0.05f), true);
    for (int k = 1; k <= 10; ++k) tree->updateNode(octomap::point3d(x - 0.1f * static_cast<float>(k), y, 0.05f), false);
  }
  tree->toMaxLikelihood();
  tree->prune();
}

TEST(MapComparison, WhatStandsFreeAndUnknownIsCounted) {
  octomap::OcTree map(0.1), same(0.1), beside(0.1), away(0.1);
  add_wall(&map, 1.05f);
  add_wall(&same, 1.05f);
  add_wall(&beside, 1.15f);
  add_wall(&away, 1.45f);
  EXPECT_EQ(compare(map, same, 0.0).stands, 20);
  EXPECT_EQ(compare(map, beside, 0.0).free, 20);
  EXPECT_EQ(compare(map, beside, 0.1).stands, 20);
  EXPECT_EQ(compare(beside, map, 0.0).unknown, 20) << "nothing is known behind the wall";
  EXPECT_EQ(compare(map, away, 0.1).free, 20);
  EXPECT_DOUBLE_EQ(compare(map, away, 0.1).share(), 0.0);
  EXPECT_DOUBLE_EQ(compare(map, same, 0.1).share(), 1.0);
}

TEST(MapComparison, MapsOfOtherVoxelsAreComparedByPlaces) {
  octomap::OcTree fine(0.05), coarse(0.1);
  fine.updateNode(octomap::point3d(0.025f, 0.025f, 0.025f), true);
  fine.updateNode(octomap::point3d(0.325f, 0.025f, 0.025f), true);
  coarse.updateNode(octomap::point3d(0.05f, 0.05f, 0.05f), true);
  coarse.updateNode(octomap::point3d(0.35f, 0.05f, 0.05f), false);
  const Agreement agreement = compare(fine, coarse, 0.0);
  EXPECT_EQ(agreement.stands, 1);
  EXPECT_EQ(agreement.free, 1);
}

TEST(MapPicture, ShowsWhatStandsFromAbove) {
  octomap::OcTree map(0.1);
  map.updateNode(octomap::point3d(0.05f, 0.05f, 0.05f), true);
  map.updateNode(octomap::point3d(0.35f, 0.45f, 0.05f), false);
  map.updateNode(octomap::point3d(0.25f, 0.45f, 0.05f), true);
  map.updateNode(octomap::point3d(0.25f, 0.25f, 2.05f), true);
  EXPECT_EQ(picture_of(map, {.high_m = 1.0}), "  #.\n\n#\n");
  EXPECT_EQ(picture_of(map, {}), "  #.\n  #\n#\n");
  EXPECT_EQ(picture_of(map, {.low_m = 3.0}), "");
  EXPECT_EQ(picture_of(map, {.high_m = 1.0, .columns = 2}), " #\n#\n") << "two voxels a letter, four a line";
  EXPECT_EQ(picture_of(octomap::OcTree(0.1), {}), "");
}

class Saving : public Bench<SaveNode> {
 public:
  Saving() : Bench(3, 7) {}

  void hear(std::int16_t map_state, int written) {
    perception_status_t status{};
    status.header = make_header(3, 1, seq_++, now);
    status.map_state = map_state;
    status.maps_written = written;
    send(channel::kPerceptionStatus, status);
  }
  int asked() const { return out.count(channel::kSaveMap); }

 private:
  std::int64_t seq_ = 1;
};

TEST(SaveNode, AsksOnceAndWaitsUntilTheMapIsWritten) {
  Saving saving;
  saving.run_for(1.0);
  EXPECT_EQ(saving.node.progress(), Progress::kSilent);
  EXPECT_EQ(saving.asked(), 0);
  saving.hear(perception_status_t::kMapKept, 2);
  saving.run_for(1.0);
  EXPECT_EQ(saving.asked(), 1);
  saving.hear(perception_status_t::kMapKept, 2);
  EXPECT_EQ(saving.node.progress(), Progress::kAsked);
  saving.run_for(1.0);
  EXPECT_EQ(saving.asked(), 1);
  saving.hear(perception_status_t::kMapFull, 3);
  EXPECT_EQ(saving.node.progress(), Progress::kWritten);
  EXPECT_TRUE(saving.node.is_full());
}

TEST(SaveNode, SaysWhatWentWrong) {
  Saving none;
  none.hear(perception_status_t::kNoMap, 0);
  EXPECT_EQ(none.node.progress(), Progress::kKeepsNone);
  none.run_for(1.0);
  EXPECT_EQ(none.asked(), 0);
  Saving fails;  // and did so before it was asked
  fails.hear(perception_status_t::kMapNotWritten, 0);
  EXPECT_EQ(fails.node.progress(), Progress::kAsked);
  fails.run_for(1.0);
  fails.hear(perception_status_t::kMapNotWritten, 0);
  EXPECT_EQ(fails.node.progress(), Progress::kNotWritten);
}

}  // namespace
}  // namespace swarm::test
