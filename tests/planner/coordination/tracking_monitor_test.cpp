// How far a robot is from its motion, and what that means for a while.
#include "planner_daemon/coordination/tracking_monitor.h"

#include <gtest/gtest.h>

#include "tests/support/start_time.h"

namespace swarm {
namespace {

TEST(TrackingMonitor, TheLargestOfTheLastSecondsIsTheBound) {
  TrackingMonitor error(0.3, 0.5);
  EXPECT_EQ(error.bound_m(kStart), 0.0);
  error.saw(kStart, 0.18);
  EXPECT_DOUBLE_EQ(error.bound_m(kStart), 0.08);
  for (Duration later = 10ms; later <= 10s; later += 10ms) {
    error.saw(kStart + later, 0.123);
    const double bound_m = error.bound_m(kStart + later);
    EXPECT_TRUE(bound_m == 0.08 || bound_m == 0.03) << bound_m;  // in whole centimetres
    EXPECT_EQ(bound_m, later <= 3s ? 0.08 : later >= 3500ms ? 0.03 : bound_m);
  }
}

TEST(TrackingMonitor, ASmallErrorIsNoneAndTheBoundHasABound) {
  TrackingMonitor error(0.3, 0.5);
  error.saw(kStart, TrackingMonitor::kAllowed_m);
  EXPECT_EQ(error.bound_m(kStart), 0.0);
  EXPECT_EQ(error.newest_m(), TrackingMonitor::kAllowed_m);
  error.saw(kStart, 7.0);
  EXPECT_EQ(error.bound_m(kStart), 0.3);
  EXPECT_EQ(error.bound_m(kStart - 1s), 0.0);  // the clock was set back: that is still to come
  error.forget();
  EXPECT_EQ(error.bound_m(kStart), 0.0);
}

TEST(TrackingMonitor, OffCourseIsWhatStaysSo) {
  TrackingMonitor error(0.3, 0.5);
  const auto see = [&](Duration first, Duration last, double error_m) {
    for (Duration at = first; at <= last; at += 10ms) error.saw(kStart + at, error_m);
  };
  see(0ms, 190ms, 0.6);  // a jump
  EXPECT_FALSE(error.is_off_course());
  see(200ms, 200ms, 0.5);
  see(210ms, 400ms, 0.6);
  EXPECT_FALSE(error.is_off_course());
  EXPECT_FALSE(error.was_off_course(kStart + 400ms));
  see(410ms, 410ms, 0.6);
  EXPECT_TRUE(error.is_off_course());
  error.back_on_course();
  EXPECT_FALSE(error.is_off_course());
  see(420ms, 600ms, 0.6);
  EXPECT_FALSE(error.is_off_course());
  EXPECT_TRUE(error.was_off_course(kStart + 1400ms));
  EXPECT_FALSE(error.was_off_course(kStart + 1410ms));
}

}  // namespace
}  // namespace swarm
