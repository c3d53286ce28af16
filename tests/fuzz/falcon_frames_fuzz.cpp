// Any stream of bytes: what the finder takes for a frame is one, and says the same when
// it is encoded again.
#include <optional>

#include "server/device/falcon/frames.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  const std::span<const std::uint8_t> bytes(data, size);
  FalconFrameFinder finder;
  std::size_t frames = 0;
  ForEachFtdiByte(bytes, [&](std::uint8_t byte) {
    if (!finder.Push(byte)) return;
    ++frames;
    const auto report = DecodeFalconReport(finder.frame());
    FUZZ_CHECK(report);
    FalconFrame again = EncodeFalconReport(*report);
    again[14] = finder.frame()[14];  // means nothing
    FUZZ_CHECK(again == finder.frame());
    if (const auto command = DecodeFalconCommand(finder.frame())) {
      FUZZ_CHECK(DecodeFalconCommand(EncodeFalconCommand(*command)) == command);
      FUZZ_CHECK(command->motors == report->encoders);
    }
  });
  FUZZ_CHECK(frames * kFalconFrameBytes <= size);
  FUZZ_CHECK(finder.corrupt_frames() <= size);
  // A whole frame behind whatever it was is found.
  const FalconFrame last = EncodeFalconReport({.encoders = {1, -2, 3}, .homed = 7});
  bool found = false;
  for (const std::uint8_t byte : last) found = finder.Push(byte);
  FUZZ_CHECK(found && finder.frame() == last);

  if (const auto report = DecodeFalconReport(bytes)) FUZZ_CHECK(size == kFalconFrameBytes);
  return 0;
}
