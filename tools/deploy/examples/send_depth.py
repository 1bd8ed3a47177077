"""What a depth camera sees, 20 times a second: send_depth.py [BUS [ROBOT]]. This one hovers and looks at a wall."""

import time

from arguments import open_bus
from sogm_swarm import depth_image_t

bus = open_bus(__doc__)
while True:
    image = depth_image_t()
    # Where the camera was, W [m], and its axes in W (w, x, y, z): z ahead, x right, y down. This one looks along x.
    image.position, image.orientation = [0.0, 0.0, 1.0], [0.5, -0.5, 0.5, -0.5]
    image.focal_px = [84.0, 84.0]  # of the image that is sent: smaller than the camera's, if need be
    image.center_px = [79.5, 59.5]
    image.width, image.num_pixels = 160, 160 * 120
    image.depth_mm = [3000] * image.num_pixels  # along z; 0: nothing was measured; 32767: free as far as it measures well
    bus.publish("DEPTH_IMAGE", image)
    time.sleep(0.05)
