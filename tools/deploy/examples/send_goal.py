"""Where the robot shall go: send_goal.py [BUS [ROBOT]]"""

import time

from arguments import open_bus
from sogm_swarm import goal_t, waypoint_t

bus = open_bus(__doc__)
while True:
    goal = goal_t()
    place = waypoint_t()
    place.position = [3.0, 0.0, 1.0]  # W [m]; may change at any time
    goal.waypoints = [place]  # in this order
    goal.num_waypoints = len(goal.waypoints)
    bus.publish("GOAL", goal)  # again and again: a planner may start later
    time.sleep(1.0)
