// What a depth camera sees, 20 times a second: send_depth [BUS [ROBOT]]. This one hovers and looks at a wall.
#include <algorithm>
#include <chrono>
#include <thread>

#include "arguments.h"
#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node_clock.h"

int main(int argc, char** argv) {
  int robot = 0;
  swarm::LcmBus bus = open_bus(argc, argv, &robot);
  swarm::HeaderSource headers(robot, swarm::new_boot());
  for (std::vector<std::uint8_t> bytes;; std::this_thread::sleep_for(std::chrono::milliseconds(50))) {
    sogm_swarm::depth_image_t image{};
    image.header = headers.next(swarm::wall_utime());  // when it was taken
    // Where the camera was then, W [m], and its axes in W (w, x, y, z): z ahead, x right, y down. This one looks along
    // x.
    const double position[] = {0.0, 0.0, 1.0}, orientation[] = {0.5, -0.5, 0.5, -0.5};
    std::ranges::copy(position, image.position);
    std::ranges::copy(orientation, image.orientation);
    image.focal_px[0] = image.focal_px[1] = 84.0f;  // of the image that is sent: smaller than the camera's, if need be
    image.center_px[0] = 79.5f, image.center_px[1] = 59.5f;
    image.width = 160;
    image.num_pixels = 160 * 120;
    image.depth_mm.assign(160 * 120, 3000);  // along z; 0: nothing was measured; 32767: free as far as it measures well
    swarm::encode(image, &bytes);
    if (!bus.publish("DEPTH_IMAGE", bytes)) return 1;
  }
}
