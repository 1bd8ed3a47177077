"""What the flight controller shall do, 100 times a second: take_setpoints.py [BUS]"""

import sys

import swarm_bus
from sogm_swarm import setpoint_t

bus = swarm_bus.Bus(*sys.argv[1:2] or ["udpm://239.255.76.67:7700?ttl=0"])
while True:
    setpoint = bus.receive("SETPOINT", setpoint_t)
    print(*setpoint.position, flush=True)  # W [m]; velocity, acceleration, jerk, yaw, yaw_rate
