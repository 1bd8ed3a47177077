// World files: they are read or refused with one line, and what was read is written as the same world.
#include "swarm_sim/world/world_json.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {

void try_input(FuzzInput input) {
  const std::string text(text_of(input.rest()));
  World world;
  try {
    world = parse_world(text, "source", ".");
  } catch (const WorldError& error) {
    const std::string_view line = error.what();
    expect(line.starts_with("source") && line.find('\n') == line.npos, "one line names the source");
    return;
  }
  const std::string written = to_json_text(world, ".");
  const World again = parse_world(written, "written", ".");
  expect(to_json_text(again, ".") == written, "it reads back as the same world");
}

}  // namespace swarm::fuzz
