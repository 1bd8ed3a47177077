// Messages from the wire: what is accepted is within the ranges, and encoded again it is the same bytes.
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/validate.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {

void try_input(FuzzInput input) {
  const std::uint8_t number = input.byte();
  const bool mended = input.flag();
  const auto rest = input.rest();
  with_type(number, [&]<class T>(T message) {
    Bytes bytes(rest.begin(), rest.end());
    if (mended) mend<T>(&bytes);
    const Refusal refusal = decode(bytes, &message);
    expect(!mended || refusal == Refusal::kNone || refusal == Refusal::kValue || refusal == Refusal::kInconsistent,
           "a mended message is refused for what it says only");
    if (refusal != Refusal::kNone) return;
    expect(validate(message.header) == Refusal::kNone && validate(message) == Refusal::kNone, "it is valid");
    Bytes again;
    encode(message, &again);
    expect(again == bytes, "encoded again it is the same bytes");
    T cut;
    expect(decode(std::span(bytes).first(bytes.size() - 1), &cut) != Refusal::kNone, "cut short it is refused");
  });
}

}  // namespace swarm::fuzz
