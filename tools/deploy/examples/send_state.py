"""Where the robot is, 50 times a second: send_state.py [BUS [ROBOT]]. This one is where its setpoints say."""

import threading
import time

from arguments import open_bus
from sogm_swarm import robot_state_t, setpoint_t

bus = open_bus(__doc__)
position = [0.0, 0.0, 1.0]  # W [m]


def follow():
    while True:
        setpoint = bus.receive("SETPOINT", setpoint_t)
        if setpoint.header.robot_id == bus.robot:
            position[:] = setpoint.position


threading.Thread(target=follow, daemon=True).start()
while True:
    state = robot_state_t()
    state.position = list(position)  # yours: from odometry or motion capture, measured now
    bus.publish("ROBOT_STATE", state)
    time.sleep(0.02)
