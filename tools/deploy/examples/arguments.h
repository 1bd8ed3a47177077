// What the examples share: they are called with [BUS [ROBOT]]. Anything else is answered with a usage line and exit
// code 2.
#pragma once

#include <charconv>
#include <cstdlib>
#include <iostream>
#include <stdexcept>
#include <string_view>

#include "lcmtypes/bus/bus_url.h"
#include "lcmtypes/bus/lcm_bus.h"

// Opens the bus; `*robot` becomes the robot's number.
inline swarm::LcmBus open_bus(int argc, char** argv, int* robot) {
  try {
    const std::string_view number = argc > 2 ? argv[2] : "0";
    const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), *robot);
    if (error != std::errc() || end != number.data() + number.size() || *robot < 0 || *robot > 32767)
      throw std::invalid_argument("ROBOT must be a number within [0, 32767]");
    if (argc > 3) throw std::invalid_argument("more than BUS and ROBOT");
    return swarm::LcmBus(argc > 1 ? argv[1] : swarm::kDefaultOnboardUrl);
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\nusage: " << argv[0] << " [BUS [ROBOT]], as " << argv[0] << " '"
              << swarm::kDefaultOnboardUrl << "' 0\n";
    std::exit(2);
  }
}
