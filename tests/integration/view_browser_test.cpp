// The view in a real browser, where no robot has to live on meanwhile: a log, and a connection that is lost.
#include <map>

#include "tests/support/view_program.h"
#include "tests/support/web_browser.h"

namespace swarm::test {
namespace {

// What is shown, and from when.
TEST(ViewControls, LogIsPlayedAndItsPartsAreHidden) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  TemporaryDirectory out;
  fly(out.path());
  View view({out / "robot0.lcm", out / "robot1.lcm", out / "swarm.lcm", "--three", kThree});
  Browser browser("http://127.0.0.1:" + std::to_string(view.port()) + "/");
  const auto until = [&](const std::string& expression) {
    return browser.wait_until(30.0 * kPatience, expression) ? "" : browser.evaluate("shown()").dump();
  };
  const auto set = [&](const std::string& id, const std::string& value) {
    (void)browser.evaluate("{ const box = document.getElementById('" + id + "'); box.value = '" + value +
                           "'; box.dispatchEvent(new Event('input')); box.dispatchEvent(new Event('change')); }");
  };
  EXPECT_EQ(until("typeof shown !== 'undefined' && shown().mode === 'log' && shown().voxels > 0"), "");
  EXPECT_EQ(until("document.getElementById('play').textContent === 'Play'"), "") << "it has come to its end";
  set("speed", "0.1");
  browser.press(" ");
  EXPECT_EQ(until("document.getElementById('play').textContent === 'Pause' && shown().at_s > 0.05"), "");
  EXPECT_LT(browser.evaluate("shown().at_s").get<double>(), 1.5) << "slowly, from the beginning";
  browser.click_on("#play");
  EXPECT_EQ(until("document.getElementById('play').textContent === 'Play'"), "");
  set("slider", "1.5");
  EXPECT_EQ(until("shown().at_s === 1.5 && shown().voxels > 0 && shown().corridors > 0 && shown().obstacles > 0"), "");
  EXPECT_EQ(until("shown().samples.find(([name]) => name === 'clearance')[1].every((count) => count > 0)"), "");
  // A frame of the map is less than all, another robot's map another one.
  const auto voxels = browser.evaluate("shown().voxels").get<int>();
  set("frame", "3");
  EXPECT_EQ(until("shown().voxels > 0 && shown().voxels < " + std::to_string(voxels)), "");
  set("frame", "-1");
  EXPECT_EQ(until("shown().voxels === " + std::to_string(voxels)), "");
  browser.click_on(".robot:nth-child(2)");
  EXPECT_EQ(until("shown().selected === 1 && shown().voxels > 0"), "");
  set("select", "0");
  EXPECT_EQ(until("shown().selected === 0 && shown().voxels === " + std::to_string(voxels)), "");
  for (const auto& [box, what] :
       std::map<std::string, std::string>{{"show-sogm", "shown().voxels"},
                                          {"show-corridors", "shown().corridors"},
                                          {"show-obstacles", "Number(scene.obstacleGroup.visible)"}}) {
    browser.click_on("#" + box);
    EXPECT_EQ(until(what + " === 0"), "") << box;
    browser.click_on("#" + box);
    EXPECT_EQ(until(what + " > 0"), "") << box;
  }
  set("select", "none");
  EXPECT_EQ(until("shown().selected === null && shown().voxels + shown().corridors === 0"), "");
  EXPECT_EQ(browser.evaluate("document.getElementById('orders').hidden"), WebJson(true)) << "of a log";
}

// They are counted anew by each connection.
TEST(ViewControls, RefusalsAreShownAfterAReconnectionToo) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  View view({"--onboard", "0", "--allow-goals", "true", "--three", kThree});
  Browser browser("http://127.0.0.1:" + std::to_string(view.port()) + "/");
  const auto until = [&](const std::string& expression) { return browser.wait_until(30.0 * kPatience, expression); };
  EXPECT_TRUE(until("typeof shown !== 'undefined' && shown().mode === 'live'"));
  for (int connection = 1; connection <= 2; ++connection) {
    (void)browser.evaluate("tell({order: {robots: [7], name: 'land'}})");
    EXPECT_TRUE(until("shown().message.includes('order: robot 7')")) << connection;
    (void)browser.evaluate("error.since = -Infinity, socket.close()");
    EXPECT_TRUE(until("socket.readyState === WebSocket.OPEN && !shown().message.includes('order')")) << connection;
  }
}

}  // namespace
}  // namespace swarm::test
