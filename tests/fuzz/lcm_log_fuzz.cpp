// Log files: every byte is in an event or counted as skipped, and an event that is gone back to is the same again.
#include "lcmtypes/bus/lcm_log.h"
#include "lcmtypes/bus/limits.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {

void try_input(FuzzInput input) {
  constexpr std::int64_t kHeader = 28;
  const auto bytes = input.rest();
  const MemoryFile file(bytes);
  LcmLog log(file.path());
  expect(log.size() == std::ssize(bytes), "the size is the file's");
  std::vector<LogEvent> events;
  std::int64_t in_events = 0, end = 0;
  for (LogEvent event; log.next(&event);) {
    expect(event.offset >= end, "events follow each other");
    expect(event.utime >= Utime() && event.utime <= kMaxUtime, "times can be reckoned with");
    const auto length = kHeader + static_cast<std::int64_t>(event.channel.size() + event.bytes.size());
    end = event.offset + length;
    in_events += length;
    events.push_back(event);
  }
  expect(in_events + log.skipped() == log.size(), "every byte is in an event or skipped");
  for (auto it = events.rbegin(); it != events.rend(); ++it) {
    LogEvent again;
    log.go_to(it->offset);
    expect(log.next(&again) && again.offset == it->offset && again.utime == it->utime && again.channel == it->channel &&
               again.bytes == it->bytes,
           "it is there again");
  }
}

}  // namespace swarm::fuzz
