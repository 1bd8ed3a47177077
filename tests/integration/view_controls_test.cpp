// Every control of the view's page, by mouse and keyboard in a real browser.
#include <cmath>
#include <map>

#include "tests/support/view_program.h"
#include "tests/support/web_browser.h"

namespace swarm::test {
namespace {

// A page that watches robots which hover, hears what they are told, and says how their daemons are doing.
class ControlledView {
 public:
  explicit ControlledView(std::vector<Eigen::Vector3d> places, bool allow_goals = true)
      : places_(std::move(places)),
        view_({"--onboard", ids(), "--allow-goals", allow_goals ? "true" : "false", "--three", kThree}),
        browser_("http://127.0.0.1:" + std::to_string(view_.port()) + "/") {
    for (std::size_t id = 0; id < places_.size(); ++id) {
      LcmBus& bus = *buses_.emplace_back(std::make_unique<LcmBus>(onboard_url(static_cast<int>(id))));
      bus.subscribe(channel::kFlightOrder, [&, id](std::string_view, std::span<const std::uint8_t> bytes) {
        EXPECT_EQ(decode(bytes, &orders[static_cast<int>(id)].emplace_back()), Refusal::kNone);
      });
      bus.subscribe(channel::kGoal, [&, id](std::string_view, std::span<const std::uint8_t> bytes) {
        EXPECT_EQ(decode(bytes, &goals[static_cast<int>(id)].emplace_back()), Refusal::kNone);
      });
    }
    EXPECT_TRUE(until("typeof shown !== 'undefined' && shown().cards.length === " + std::to_string(places_.size()) +
                      " && shown().cards.every((card) => card.includes('holding its place'))"));
  }

  // The swarm lives on until the page says so, or `enough` does; false: it did not.
  bool until(const std::function<bool()>& enough) {
    return wait_for(30.0 * kPatience, [&] {
      live();
      return enough();
    });
  }
  bool until(const std::string& expression) {
    const bool came = until([&] { return browser_.evaluate(expression) == WebJson(true); });
    if (!came) std::cerr << expression << ": " << browser_.evaluate("shown()") << std::endl;
    return came;
  }
  void live_on(double seconds) {
    (void)wait_for(seconds, [&] {
      live();
      return false;
    });
  }

  void click(const std::string& selector) { browser_.click_on(selector); }
  void set(const std::string& selector, double value) {
    (void)browser_.evaluate("{ const box = document.querySelector('" + selector +
                            "'); box.value = " + std::to_string(value) + "; box.dispatchEvent(new Event('change')); }");
  }
  Browser& browser() { return browser_; }

  std::map<int, std::vector<sogm_swarm::order_t>> orders;  // by robot, as they came
  std::map<int, std::vector<sogm_swarm::goal_t>> goals;

 private:
  std::string ids() const {
    std::string all;
    for (std::size_t id = 0; id < places_.size(); ++id) all += (id > 0 ? "," : "") + std::to_string(id);
    return all;
  }

  void live() {
    ++seq_;
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const int id = static_cast<int>(i);
      LcmBus& bus = *buses_[i];
      while (bus.drain() > 0) continue;
      publish_hover(bus, id, places_[i], seq_);
      const auto header = make_header(id, 1, seq_, wall_utime());
      sogm_swarm::flight_status_t flight{};
      flight.header = header;
      flight.state = sogm_swarm::flight_status_t::kHold;
      flight.order_boot = -1;
      sogm_swarm::planner_status_t planner{};
      planner.header = header;
      planner.total_ms = 1.5f;
      sogm_swarm::broadcast_status_t broadcast{};
      broadcast.header = header;
      broadcast.peers_heard = 1;
      broadcast.max_age_ms = 20.0f + static_cast<float>(id);
      EXPECT_TRUE(bus.publish(channel::kFlightStatus, encoded(flight)));
      EXPECT_TRUE(bus.publish(channel::kPlannerStatus, encoded(planner)));
      EXPECT_TRUE(bus.publish(channel::kBroadcastStatus, encoded(broadcast)));
    }
  }

  std::vector<Eigen::Vector3d> places_;
  View view_;
  Browser browser_;
  std::vector<std::unique_ptr<LcmBus>> buses_;
  std::int64_t seq_ = 0;
};

const std::vector<Eigen::Vector3d> kTwo = {{-2, 0, 1}, {2, 0, 1}};

// Buttons give orders, to the robot that is looked at or to all; an emergency is asked for.
TEST(ViewControls, BrowserGivesOrders) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  ControlledView page(kTwo);
  (void)page.browser().evaluate("select(1)");
  page.set("#height", 2.0);
  for (const auto& [name, order] : std::map<std::string, int>{{"take-off", sogm_swarm::order_t::kTakeOff},
                                                              {"hold", sogm_swarm::order_t::kHold},
                                                              {"fly", sogm_swarm::order_t::kFly},
                                                              {"home", sogm_swarm::order_t::kHome},
                                                              {"land", sogm_swarm::order_t::kLand}}) {
    page.click("[data-order=" + name + "]");
    EXPECT_TRUE(page.until([&] { return !page.orders[1].empty() && page.orders[1].back().order == order; })) << name;
    EXPECT_EQ(page.orders[1].back().height, name == "take-off" ? 2.0 : 0.0);
  }
  EXPECT_TRUE(page.orders[0].empty());
  page.click("#order-all");
  (void)page.browser().evaluate("window.confirm = () => false");
  page.click("[data-order=emergency]");
  page.click("[data-order=hold]");
  EXPECT_TRUE(page.until([&] { return !page.orders[0].empty(); }));
  EXPECT_EQ(page.orders[0].front().order, sogm_swarm::order_t::kHold) << "the emergency was taken back";
  (void)page.browser().evaluate("window.confirm = () => true");
  page.click("[data-order=emergency]");
  EXPECT_TRUE(page.until([&] { return page.orders[0].back().order == sogm_swarm::order_t::kEmergency; }));
}

TEST(ViewControls, DoubleClickSetsAGoalWhereItIsAllowed) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  for (const bool allowed : {false, true}) {
    ControlledView page(kTwo, allowed);
    (void)page.browser().evaluate("select(1), document.getElementById('height').value = 2.5");
    page.browser().click(700, 400);
    page.browser().drag(700, 400, 760, 420);
    page.live_on(0.5);
    page.browser().click(650, 450, 2);
    EXPECT_EQ(page.browser().evaluate("document.getElementById('orders').hidden"), WebJson(!allowed));
    if (!allowed) {
      page.browser().press("m");
      page.browser().click(650, 450);
      page.live_on(0.5);
      EXPECT_EQ(page.browser().evaluate("document.getElementById('mission').hidden"), WebJson(true));
      EXPECT_TRUE(page.goals[0].empty() && page.goals[1].empty());
      continue;
    }
    ASSERT_TRUE(page.until([&] { return !page.goals[1].empty(); }));
    EXPECT_TRUE(page.goals[0].empty());
    const sogm_swarm::goal_t& goal = page.goals[1].front();
    ASSERT_EQ(goal.num_waypoints, 1);
    const WebJson point = page.browser().evaluate("scene.pointAt(650, 450, 2.5).toArray()");
    for (std::size_t axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(goal.waypoints[0].position[axis], point[axis].get<double>(), 0.006) << "to the centimetre";
    EXPECT_NEAR(goal.waypoints[0].position[2], 2.5, 1e-9);
  }
}

TEST(ViewControls, DoubleClickAtNoPlaceIsRefused) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  ControlledView page(kTwo);
  (void)page.browser().evaluate("select(1), document.getElementById('height').value = ''");
  page.browser().click(650, 450, 2);
  EXPECT_TRUE(page.until("shown().message === 'height of goals: must be a number'"));
  page.set("#height", 1.0);
  (void)page.browser().evaluate("scene.controls.target.set(0, 0, 3), scene.camera.position.set(0, -20, 3)");
  const double y = 2.0 + 0.5 * page.browser().evaluate("window.innerHeight").get<double>();
  EXPECT_TRUE(page.until("scene.pointAt(650, innerHeight / 2 + 2, 1)?.length() > 600")) << "at the horizon";
  page.browser().click(650, y, 2);
  EXPECT_TRUE(page.until("shown().message === 'no place at that height within 500 m'"));
  page.live_on(0.5);
  EXPECT_TRUE(page.goals[1].empty());
}

TEST(ViewControls, MissionIsPlannedAndSent) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  ControlledView page(kTwo);
  Browser& browser = page.browser();
  (void)browser.evaluate("select(0)");
  browser.press("m");
  EXPECT_TRUE(page.until("!document.getElementById('mission').hidden"));
  EXPECT_EQ(browser.evaluate("document.getElementById('mission-send').disabled"), WebJson(true)) << "there is nothing";
  for (const double x : {560.0, 660.0, 760.0}) {
    browser.click(x, 420);
    page.live_on(0.1);
  }
  browser.drag(600, 420, 640, 440);
  EXPECT_TRUE(page.until("shown().waypoints.length === 3 && shown().marks === 3")) << "drawn before it is sent";
  EXPECT_TRUE(page.goals[0].empty());
  // The list: height, waiting time, one less; what is no number within the limits is put back.
  page.set("#waypoints tr:nth-child(2) [name=z]", 2.25);
  page.set("#waypoints tr:nth-child(2) [name=wait_s]", 3.0);
  page.set("#waypoints tr:nth-child(3) [name=wait_s]", -1.0);
  page.click("#waypoints tr:nth-child(1) button");
  page.set("#times", 3.0);
  EXPECT_TRUE(page.until("shown().waypoints.length === 2 && shown().marks === 2"));
  const WebJson waypoints = browser.evaluate("shown().waypoints");
  EXPECT_EQ(waypoints[0]["z"], 2.25);
  EXPECT_EQ(waypoints[0]["wait_s"], 3.0);
  EXPECT_EQ(waypoints[1]["wait_s"], 0.0);
  // Another robot's is another.
  (void)browser.evaluate("select(1)");
  EXPECT_TRUE(page.until("shown().waypoints.length === 0 && shown().marks === 0"));
  (void)browser.evaluate("select(0)");
  page.click("#mission-send");
  ASSERT_TRUE(page.until([&] { return !page.goals[0].empty(); }));
  const sogm_swarm::goal_t& goal = page.goals[0].front();
  ASSERT_EQ(goal.num_waypoints, 6);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(goal.waypoints[i].position[0], waypoints[i % 2]["x"].get<double>());
    EXPECT_EQ(goal.waypoints[i].position[1], waypoints[i % 2]["y"].get<double>());
    EXPECT_EQ(goal.waypoints[i].position[2], waypoints[i % 2]["z"].get<double>());
    EXPECT_EQ(goal.waypoints[i].wait, i % 2 == 0 ? 3.0 : 0.0);
  }
  EXPECT_TRUE(page.until("document.getElementById('mission').hidden && shown().marks === 0"));
  page.click("#mission-edit");
  EXPECT_TRUE(page.until("shown().waypoints.length === 2")) << "it is still there";
  page.set("#times", 501.0);
  EXPECT_TRUE(page.until("document.getElementById('mission-send').disabled")) << "1002 places";
  page.click("#mission-cancel");
  EXPECT_TRUE(page.until("document.getElementById('mission').hidden && shown().marks === 0"));
  page.click("#mission-edit");
  EXPECT_TRUE(page.until("!document.getElementById('mission').hidden && shown().waypoints.length === 0"));
  browser.press("Escape");
  EXPECT_TRUE(page.until("document.getElementById('mission').hidden"));
  EXPECT_TRUE(page.goals[1].empty());
  (void)browser.evaluate("tell({goal: {robot: 0, waypoints: [{position: [0, 0, 1], wait_s: -1}]}})");
  EXPECT_TRUE(page.until("shown().message === 'waypoint 1: wait_s -1: must be a number within [0, 86400]'"));
}

// The first click after a value was typed does what it is for.
TEST(ViewControls, MissionIsTypedAndClicked) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  ControlledView page(kTwo);
  Browser& browser = page.browser();
  (void)browser.evaluate("select(0), mission.open(), [1, 2, 3].forEach((x) => mission.add([x, 0, 1]))");
  const auto type = [&](const std::string& selector, const std::string& text) {
    page.click(selector);
    (void)browser.evaluate("document.execCommand('selectAll')");
    (void)browser.evaluate("document.execCommand('insertText', false, " + text + ")");
  };
  type("#waypoints tr:nth-child(1) [name=z]", "25");
  page.click("#waypoints tr:nth-child(2) [name=x]");
  EXPECT_EQ(browser.evaluate("document.activeElement.name"), WebJson("x")) << "it has the focus at once";
  EXPECT_EQ(browser.evaluate("shown().waypoints[0].z"), WebJson(25));
  type("#waypoints tr:nth-child(2) [name=wait_s]", "7");
  page.click("#waypoints tr:nth-child(3) button");
  EXPECT_EQ(browser.evaluate("shown().waypoints.map((one) => one.wait_s)"), WebJson({0, 7}));
  type("#times", "4");
  page.click("#waypoints tr:nth-child(1) button");
  EXPECT_EQ(browser.evaluate("shown().waypoints.map((one) => one.wait_s)"), WebJson({7}));
  EXPECT_EQ(browser.evaluate("shown().marks"), WebJson(1));
  page.click("#mission-send");
  ASSERT_TRUE(page.until([&] { return !page.goals[0].empty(); }));
  EXPECT_EQ(page.goals[0].front().num_waypoints, 4);
}

// Of the longest numbers that can be typed.
TEST(ViewControls, LongestMissionIsSentAndKeptUntilThen) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  ControlledView page(kTwo);
  (void)page.browser().evaluate(
      "select(0), mission.open();"
      "for (let i = 0; i < MOST_WAYPOINTS; ++i) mission.add([0, 0, 0]);"
      "for (const input of document.querySelectorAll('#waypoints input')) {"
      "  input.value = input.name === 'wait_s' ? '86399.12345678901' : '-99999.12345678901';"
      "  input.dispatchEvent(new Event('change'));"
      "}"
      "socket.close();"
      "element('mission-send').click();");
  EXPECT_EQ(page.browser().evaluate("document.getElementById('mission-hint').textContent"),
            WebJson("Not sent: there is no connection."));
  EXPECT_EQ(page.browser().evaluate("shown().waypoints.length"), WebJson(50));
  EXPECT_TRUE(page.until("socket.readyState === WebSocket.OPEN"));
  (void)page.browser().evaluate("element('mission-send').scrollIntoView()");
  page.click("#mission-send");
  ASSERT_TRUE(page.until([&] { return !page.goals[0].empty(); }));
  EXPECT_EQ(page.goals[0].front().num_waypoints, 50);
  EXPECT_EQ(page.goals[0].front().waypoints[49].position[1], -99999.12);
  EXPECT_NEAR(page.goals[0].front().waypoints[49].wait, 86399.12, 1e-6);
}

// Pixels of a robot's colour on each plot.
constexpr const char* kInk =
    "[...document.querySelectorAll('.plot canvas')].map((canvas) => {"
    "  const all = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;"
    "  const color = new THREE.Color(robotColor(1)).toArray().map((part) => 255 * part);"
    "  let count = 0;"
    "  for (let i = 0; i < all.length; i += 4)"
    "    if (all[i + 3] > 200 && color.every((part, k) => Math.abs(part - all[i + k]) < 12)) ++count;"
    "  return count; })";

TEST(ViewControls, PlotsShowTheLastMinute) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  ControlledView page(kTwo);
  (void)page.browser().evaluate("select(1)");
  EXPECT_TRUE(page.until("shown().samples.every(([, counts]) => counts.every((count) => count > 20))"));
  EXPECT_TRUE(page.until(std::string(kInk) + ".every((count) => count > 20)")) << page.browser().evaluate(kInk);
  const WebJson values =
      page.browser().evaluate("[...document.querySelectorAll('.plot span')].map((span) => span.textContent)");
  EXPECT_EQ(values, WebJson({"0.00 m/s", "3.50 m", "1.50 ms", "21 ms"})) << "4 m apart, 0.25 m each";
  // To the surface of every shape, turned by a quarter where that matters.
  const std::map<std::string, double> distances = {
      {"{shape: 'column', size: [1, 4, 0], yaw: 0, position: [3, 4, 1]}, [0, 0, 1]", 4.5},
      {"{shape: 'column', size: [1, 4, 0], yaw: 0, position: [0, 0, 1]}, [0, 0, 5]", 2.0},
      {"{shape: 'sphere', size: [1, 0, 0], yaw: 0, position: [1, 2, 3]}, [1, 2, 0]", 2.5},
      {"{shape: 'box', size: [4, 1, 1], yaw: Math.PI / 2, position: [0, 0, 0]}, [2, 0, 0]", 1.5},
      {"{shape: 'box', size: [4, 1, 1], yaw: 0, position: [0, 0, 0]}, [1, 0, 0]", 0.0},
      {"{shape: 'ring', size: [2, 0.5, 0], yaw: 0, position: [0, 0, 1]}, [0, 0, 1]", 1.75},
      {"{shape: 'ring', size: [2, 0.5, 0], yaw: Math.PI / 2, position: [0, 0, 0]}, [2, 3, 0]", 2.75}};
  for (const auto& [obstacle_and_point, distance] : distances) {
    EXPECT_NEAR(page.browser().evaluate("distanceTo(" + obstacle_and_point + ")").get<double>(), distance, 1e-9)
        << obstacle_and_point;
  }
  page.browser().press("p");
  EXPECT_TRUE(page.until("document.getElementById('plots').hidden"));
  page.click("#show-plots");
  EXPECT_TRUE(page.until("!document.getElementById('plots').hidden"));
}

TEST(ViewControls, HelpOpensAndCloses) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  ControlledView page({{0, 0, 1}});
  const std::string hidden = "document.getElementById('help').hidden";
  EXPECT_EQ(page.browser().evaluate(hidden), WebJson(true));
  page.browser().press("?");
  EXPECT_EQ(page.browser().evaluate("!" + hidden + " && document.getElementById('help').innerText.includes('Esc')"),
            WebJson(true));
  page.browser().press("Escape");
  EXPECT_EQ(page.browser().evaluate(hidden), WebJson(true));
  page.click("#help-open");
  EXPECT_EQ(page.browser().evaluate(hidden), WebJson(false));
  page.click("#help-close");
  EXPECT_EQ(page.browser().evaluate(hidden), WebJson(true));
  (void)page.browser().evaluate("document.getElementById('height').focus()");
  page.browser().press("?");
  EXPECT_EQ(page.browser().evaluate(hidden), WebJson(true)) << "somebody types";
}

// How far the camera is from a place, and its target.
WebJson camera(ControlledView& page) {
  return page.browser().evaluate("shown().camera");
}

TEST(ViewControls, CameraFindsARobot) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  ControlledView page({{-20, 0, 1}, {30, 4, 2}});
  EXPECT_TRUE(page.until("shown().camera.target[0] === 5"));
  EXPECT_GT(camera(page)["position"][2], 20.0) << "from above, to see both";
  (void)page.browser().evaluate("select(1)");
  page.browser().press("f");
  EXPECT_TRUE(page.until("shown().camera.target.join() === '30,4,2'"));
  EXPECT_LT(camera(page)["position"][2], 8.0);
  page.browser().press("a");
  EXPECT_TRUE(page.until("shown().camera.target[0] === 5"));
  (void)page.browser().evaluate("select(0)");
  page.click("#follow");
  EXPECT_TRUE(page.until("shown().camera.target.join() === '-20,0,1'"));
}

TEST(ViewControls, CameraFindsTheOnlyRobot) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  ControlledView page({{100, -50, 3}});
  EXPECT_TRUE(page.until("shown().camera.target.join() === '100,-50,3'"));
  page.browser().drag(500, 300, 700, 500);
  (void)page.browser().evaluate("select(null), scene.aim([[0, 0, 0]])");
  page.browser().press("f");
  EXPECT_TRUE(page.until("shown().camera.target.join() === '100,-50,3'"));
}

TEST(ViewControls, NamesDoNotCoverEachOther) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  std::vector<Eigen::Vector3d> places;
  for (int i = 0; i < 6; ++i) places.push_back({0.05 * i, 0.0, 1.0});
  places.push_back({4.0, 0.0, 1.0});
  ControlledView page(places);
  EXPECT_TRUE(page.until("shown().names.length === 7"));
  const WebJson names = page.browser().evaluate("shown().names");
  int hidden = 0;
  for (const WebJson& one : names) {
    if (one["box"].is_null()) {
      ++hidden;
      continue;
    }
    for (const WebJson& other : names) {
      if (other["id"] <= one["id"] || other["box"].is_null()) continue;
      const auto apart = [&](const char* at, const char* size) {
        const double first = one["box"][at], second = other["box"][at];
        return first + one["box"][size].get<double>() <= second || second + other["box"][size].get<double>() <= first;
      };
      EXPECT_TRUE(apart("x", "width") || apart("y", "height")) << one << " " << other;
    }
  }
  EXPECT_GT(hidden, 0) << "six in a place are too many";
  EXPECT_LT(hidden, 4) << "four fit, one above the other";
  EXPECT_FALSE(names[6]["box"].is_null()) << "it is alone";
}

}  // namespace
}  // namespace swarm::test
