// Messages for programs that do not speak LCM: as JSON, and drawn as Foxglove's scenes. Whatever a message that was
// accepted says becomes text that reads back.
#include "tests/fuzz/fuzz_input.h"
#include "tools/logs/foxglove.h"
#include "tools/logs/log_drawing.h"
#include "tools/logs/log_messages.h"
#include "tools/logs/message_json.h"

namespace swarm::fuzz {
namespace {

using Json = nlohmann::ordered_json;

void check_text(const Json& json) {
  const std::string text = json.dump();
  expect(Json::accept(text), "it is JSON");
}

}  // namespace

void try_input(FuzzInput input) {
  LogDrawing drawing({input.real(0.0, 1.0)}, [](const Drawing& drawn) {
    expect(!drawn.topic.empty() && drawn.topic.front() == '/', "a topic is a path");
    expect(foxglove::schema(drawn.schema).is_object(), "its schema is there");
    check_text(drawn.message);
  });
  Utime now{};
  while (!input.empty()) {
    const Channel& channel = kChannels[input.byte() % std::size(kChannels)];
    now += Duration(input.word(3));
    const Bytes bytes = message_bytes(input, channel.name);
    (void)visit_message(channel.name, bytes, [&]<class T>(const T& message) {
      const Json json = to_json(message);
      expect(json.is_object() && json.contains("header"), "a message is an object with its header");
      check_text(json);
      drawing.add(now, channel.name, message);
    });
  }
}

}  // namespace swarm::fuzz
