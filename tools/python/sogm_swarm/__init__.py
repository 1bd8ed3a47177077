"""SOGM swarm in Python: all messages (goal_t, robot_state_t, ...: lcmtypes/README.md says what they mean), and

sogm_swarm.bus     sends and hears them: Bus
sogm_swarm.robot   tells a robot where to go and what to do: Robot
sogm_swarm.logs    reads LCM logs, also as numpy arrays: arrays()

It needs nothing but the standard library; arrays() needs numpy.
"""

