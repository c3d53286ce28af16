// Any stream of bytes: the same frames come out however it is cut, and each is in the
// stream as it would be encoded.
#include <vector>

#include "server/device/omni/firewire_frames.h"
#include "server/device/omni/usb_frames.h"
#include "tests/fuzz/fuzz_input.h"

namespace {

using namespace palpate;
using Bytes = std::vector<std::uint8_t>;

OmniUsbParser Parser() {
  OmniUsbParser parser;
  parser.Expect(kOmniUsbFirmwareReply);
  parser.Expect({.command = 0x10, .payload_bytes = kOmniStateBytes});
  return parser;
}

void AppendFrames(OmniUsbParser& parser, std::span<const std::uint8_t> bytes, Bytes& frames) {
  while (const auto frame = parser.Next(bytes)) {
    std::array<std::uint8_t, kOmniUsbMaxFrameBytes> encoded{};
    const std::size_t size = EncodeOmniUsbFrame(frame->command, frame->payload, encoded);
    FUZZ_CHECK(size == kOmniUsbHeaderBytes + frame->payload.size());
    frames.insert(frames.end(), encoded.begin(),
                  encoded.begin() + static_cast<std::ptrdiff_t>(size));
  }
}

}  // namespace

// The first byte says where the stream is cut.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Input input({data, size});
  const std::size_t piece = 1u + input.Take<std::uint8_t>();
  const auto stream = input.TakeBytes(size);
  OmniUsbParser whole = Parser(), cut = Parser();
  Bytes of_whole, of_cut;
  AppendFrames(whole, stream, of_whole);
  for (std::size_t at = 0; at < stream.size(); at += piece) {
    AppendFrames(cut, stream.subspan(at, std::min(piece, stream.size() - at)), of_cut);
  }
  FUZZ_CHECK(of_whole == of_cut);
  FUZZ_CHECK(whole.corrupt_bytes() == cut.corrupt_bytes());
  FUZZ_CHECK(whole.corrupt_runs() == cut.corrupt_runs());
  FUZZ_CHECK(of_whole.size() + whole.corrupt_bytes() <= stream.size());
  FUZZ_CHECK(whole.corrupt_runs() <= whole.corrupt_bytes());
  // Nothing is added or exchanged: frames are parts of the stream, in its order.
  auto rest = stream.begin();
  for (std::size_t at = 0; at < of_whole.size();) {
    const std::size_t bytes = kOmniUsbHeaderBytes + of_whole[at + 3];
    const auto frame = of_whole.begin() + static_cast<std::ptrdiff_t>(at);
    const auto found =
        std::search(rest, stream.end(), frame, frame + static_cast<std::ptrdiff_t>(bytes));
    FUZZ_CHECK(found != stream.end());
    rest = found + static_cast<std::ptrdiff_t>(bytes);
    at += bytes;
  }
  return 0;
}
