"""Where the robot shall go: send_goal.py [BUS [ROBOT]]"""

import sys
import time

import swarm_bus
from sogm_swarm import goal_t, waypoint_t

bus = swarm_bus.Bus(*sys.argv[1:2] or ["udpm://239.255.76.67:7700?ttl=0"], *map(int, sys.argv[2:3]))
while True:
    goal = goal_t()
    place = waypoint_t()
    place.position = [3.0, 0.0, 1.0]  # W [m]; may change at any time
    goal.waypoints = [place]  # in this order
    goal.num_waypoints = len(goal.waypoints)
    bus.publish("GOAL", goal)  # again and again: a planner may start later
    time.sleep(1.0)
