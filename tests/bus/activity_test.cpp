// When the log is told what a node is about.
#include "lcmtypes/bus/activity.h"

#include <gtest/gtest.h>

namespace swarm {
namespace {

class ActivityLogTest : public testing::Test {
 protected:
  // What is written at `at`; "-": nothing.
  std::string line(Duration at, const Activity& activity) {
    const auto line = log_.update(Utime(1000s) + at, activity);
    return line ? (line->is_warning ? "WARNING " : "") + line->text : "-";
  }

  ActivityLog log_;
};

TEST_F(ActivityLogTest, WhatIsNewIsSaidOnce) {
  EXPECT_EQ(line(0s, {}), "-");
  EXPECT_EQ(line(1s, {.text = "flies"}), "flies");
  EXPECT_EQ(line(4s, {.text = "flies", .detail = "at 2 m/s"}), "-");
  EXPECT_EQ(line(60s, {.text = "flies"}), "-");
  EXPECT_EQ(line(61s, {.text = "rests", .detail = "at the goal"}), "rests: at the goal");
  EXPECT_EQ(line(64s, {.text = "flies"}), "flies");
}

TEST_F(ActivityLogTest, WhatChangesAllTheTimeIsSaidNowAndThen) {
  int lines = 0;
  for (int i = 0; i < 30; ++i) lines += line(i * 1s, {.text = i % 2 == 0 ? "flies" : "rests"}) != "-";
  EXPECT_EQ(lines, 10);
}

TEST_F(ActivityLogTest, WhatIsWaitedForIsSaidAgain) {
  EXPECT_EQ(line(0s, waits_for("GOAL")), "waits for GOAL");
  EXPECT_EQ(line(9s, waits_for("GOAL", "for 9 s")), "-");
  EXPECT_EQ(line(10s, waits_for("GOAL", "for 10 s")), "WARNING still waits for GOAL: for 10 s");
  EXPECT_EQ(line(19s, waits_for("GOAL")), "-");
  EXPECT_EQ(line(20s, waits_for("GOAL")), "WARNING still waits for GOAL");
  EXPECT_EQ(line(23s, waits_for("SOGM")), "WARNING waits for SOGM") << "it has waited for something all the time";
  EXPECT_EQ(line(32s, waits_for("SOGM")), "-");
  EXPECT_EQ(line(33s, waits_for("SOGM")), "WARNING still waits for SOGM");
  EXPECT_EQ(line(40s, {.text = "plans"}), "plans");
  EXPECT_EQ(line(43s, waits_for("SOGM")), "waits for SOGM");
}

TEST_F(ActivityLogTest, AClockThatIsSetBackDelaysNothing) {
  EXPECT_EQ(line(100s, waits_for("GOAL")), "waits for GOAL");
  EXPECT_EQ(line(1s, waits_for("GOAL")), "-");
  EXPECT_EQ(line(11s, waits_for("GOAL")), "WARNING still waits for GOAL");
}

}  // namespace
}  // namespace swarm
