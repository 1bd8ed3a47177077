"""What an operator tells a robot, as swarm_goal does: again and again, until the robot says that it heard it."""

import math
import time

from sogm_swarm import flight_status_t, goal_t, order_t, planner_status_t, robot_state_t, waypoint_t
from sogm_swarm.bus import utime

AGAIN_S = 0.2  # a message may get lost, or the planner start later
RECEIVED_US = 20000  # a status that is so much younger than the goal is of a planner that heard it
MAX_AGE_US = 1000000
USUAL_TOLERANCE = 0.1  # [m]

STATES = {flight_status_t.kOnGround: "on the ground", flight_status_t.kTakeOff: "taking off", flight_status_t.kFlying: "flying",
          flight_status_t.kHold: "holding its place", flight_status_t.kHome: "flying home",
          flight_status_t.kLanding: "landing", flight_status_t.kEmergency: "in an emergency landing"}
# Orders, and the state in which each is done.
ORDERS = {"fly": (order_t.kFly, flight_status_t.kFlying), "hold": (order_t.kHold, flight_status_t.kHold),
          "take-off": (order_t.kTakeOff, flight_status_t.kFlying), "home": (order_t.kHome, flight_status_t.kOnGround),
          "land": (order_t.kLand, flight_status_t.kOnGround), "emergency": (order_t.kEmergency, flight_status_t.kOnGround),
          "without": (order_t.kWithout, None)}
VERDICTS = {flight_status_t.kNotNow: "has no use for that now", flight_status_t.kNotReady: "is not ready: see its broadcast_daemon's log",
            flight_status_t.kNoVehicle: "does not hear its vehicle: mavlink_bridge does not run, or hears nothing"}
WAITS = {planner_status_t.kNoMap: "a map", planner_status_t.kStaleMap: "a map", planner_status_t.kNoCommitted: "the broadcaster"}


class NotDone(Exception):
    """The robot does not do what it was told; says why."""


class Robot:
    """The robot of a bus. What it is told returns when the robot knows it, with arrive=True when it is done; NotDone where it
    is refused, or for `patience` seconds nothing shows that the robot does it."""

    def __init__(self, bus):
        self.bus = bus
        self.state = self.flight = None  # newest ROBOT_STATE and FLIGHT_STATUS
        self._planner = None  # newest PLANNER_STATUS that answers
        self._answers = 0
        self._told = math.inf

    def go(self, *places, tolerance=USUAL_TOLERANCE, speed=0.0, wait=0.0, arrive=False, patience=3.0):
        """To places (x, y, z), one after the other: W [m]. Speed is per axis [m/s], 0: the robot's; it waits at each [s]."""
        if not places:
            raise ValueError("go: to where?")
        goal = goal_t()
        for place in places:
            waypoint = waypoint_t()
            waypoint.position = [float(x) for x in place]
            waypoint.tolerance, waypoint.speed, waypoint.wait = tolerance, speed, wait
            goal.waypoints.append(waypoint)
        goal.num_waypoints = len(goal.waypoints)
        order = None  # to go on, where it holds its place or flies home
        self._planner, self._answers, self._told = None, 0, math.inf

        def tell():
            nonlocal order
            self.bus.publish("GOAL", goal)
            self._told = min(self._told, goal.header.utime)
            if self.flight and self.flight.state not in (flight_status_t.kFlying, flight_status_t.kOnGround, flight_status_t.kTakeOff):
                order = order or order_t()
                order.order = order_t.kFly
                self.bus.publish("FLIGHT_ORDER", order)

        def progress():
            """Whether it does what it was told, whether that is done, and what to say where it does not."""
            if self.flight and self.flight.state == flight_status_t.kOnGround:
                return False, False, "is on the ground: take-off comes first"
            if not self._planner:
                return False, False, f"was not heard on {self.bus.url}"
            if self._planner.state == planner_status_t.kUnreachable:
                return False, False, "knows no way there"
            if self._planner.state != planner_status_t.kPlanning:
                return False, False, f"waits for {WAITS.get(self._planner.state, 'this goal')}"
            is_last = self._planner.waypoint + 1 == len(goal.waypoints)
            is_there = self.state and math.dist(self.state.position, goal.waypoints[-1].position) <= (tolerance or USUAL_TOLERANCE)
            return True, is_last and is_there, ""

        self._until(tell, progress, arrive, patience)

    def order(self, name, height=1.5, arrive=False, patience=3.0, other=0):
        """take-off (to `height` above the ground [m]), hold, fly (to its goal again), home, land, emergency or without
        (robot `other`, which has left)."""
        if name not in ORDERS:
            raise ValueError(f"order '{name}': must be one of {', '.join(ORDERS)}")
        message, first = order_t(), None
        message.order, end = ORDERS[name]
        message.height = height if name == "take-off" else 0.0
        message.other_id = other if name == "without" else 0

        def is_heard():
            return first is not None and self.flight and self.flight.order_boot == self.bus.boot and self.flight.order_seq >= first

        def tell():
            nonlocal first
            if not is_heard():
                self.bus.publish("FLIGHT_ORDER", message)
                first = message.header.seq if first is None else first

        def progress():
            if not is_heard():
                return False, False, f"was not heard on {self.bus.url}"
            if self.flight.verdict != flight_status_t.kAccepted:
                raise NotDone(f"robot {self.bus.robot}: {VERDICTS[self.flight.verdict]}")
            if end is None:
                return True, True, ""
            if self.flight.state == flight_status_t.kOnGround != end:
                raise NotDone(f"robot {self.bus.robot}: is on the ground: the vehicle did not arm, or did not rise")
            return True, self.flight.state == end, f"is {STATES[self.flight.state]}"

        self._until(tell, progress, arrive, patience)

    def _until(self, tell, progress, arrive, patience):
        again, give_up = 0.0, time.monotonic() + patience
        while True:
            if time.monotonic() >= again:
                tell()
                again = time.monotonic() + AGAIN_S
            self._hear(0.05)
            is_known, is_done, why = progress()
            if is_done or (is_known and not arrive):
                return
            if is_known:
                give_up = time.monotonic() + patience
            elif time.monotonic() > give_up:
                raise NotDone(f"robot {self.bus.robot}: {why}")

    def _hear(self, seconds):
        types = {"ROBOT_STATE": robot_state_t, "FLIGHT_STATUS": flight_status_t, "PLANNER_STATUS": planner_status_t}
        heard = self.bus.receive_any(types, seconds)
        if not heard or heard[1].header.robot_id != self.bus.robot or utime() - heard[1].header.utime > MAX_AGE_US:
            return
        channel, message = heard
        if channel == "ROBOT_STATE":
            self.state = message
        elif channel == "FLIGHT_STATUS":
            self.flight = message
        elif message.header.utime >= self._told + RECEIVED_US:
            self._answers += 1
            if self._answers > 1:  # a busy planner may have made the first before it read the goal
                self._planner = message
