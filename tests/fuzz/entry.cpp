// Where libFuzzer comes in.
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  swarm::fuzz::try_input({data, size});
  return 0;
}
