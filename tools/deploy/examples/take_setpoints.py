"""What the flight controller shall do, 100 times a second: take_setpoints.py [BUS [ROBOT]]"""

from arguments import open_bus
from sogm_swarm import setpoint_t

bus = open_bus(__doc__)
while True:
    setpoint = bus.receive("SETPOINT", setpoint_t)
    if setpoint.header.robot_id == bus.robot:
        print(*setpoint.position, flush=True)  # W [m]; velocity, acceleration, jerk, yaw, yaw_rate
