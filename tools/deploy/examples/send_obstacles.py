"""What moves around the robot, 10 times a second: send_obstacles.py [BUS [ROBOT]]"""

import time

from arguments import open_bus
from sogm_swarm import obstacle_t, obstacles_t

bus = open_bus(__doc__)
while True:
    person = obstacle_t()
    person.id, person.shape = 7, obstacle_t.kColumn  # the id stays the same as long as you track it
    person.position = [1.5, 0.1, 0.95]  # W [m]: of its middle
    person.size = [0.6, 1.9, 0.0]  # diameter, height [m]
    everything = obstacles_t()
    everything.num_obstacles, everything.obstacles = 1, [person]
    everything.complete = True  # what is missing is gone; False, for sensors: it may only be out of sight
    bus.publish("OBSTACLES", everything)
    time.sleep(0.1)
