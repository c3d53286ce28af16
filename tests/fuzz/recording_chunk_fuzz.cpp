// Any bytes as the payload of a recording's chunk: type u16, payload. What is taken for
// a chunk is written and read again without a difference.
#include <sstream>
#include <string>

#include "server/recording/bytes.h"
#include "server/recording/chunk_codec.h"
#include "server/recording/csv_export.h"
#include "tests/fuzz/fuzz_input.h"

namespace palpate::fuzz {
namespace {

void CheckChunk(const Payload& payload) {
  const RecordedChunk chunk = DecodeChunk(payload);
  const Payload once = EncodeChunk(chunk);
  FUZZ_CHECK(once.type == payload.type);
  // Names, flags and numbers of scenes may be written in several ways.
  if (payload.type != ChunkType::kScene) FUZZ_CHECK(once.bytes == payload.bytes);
  FUZZ_CHECK(EncodeChunk(DecodeChunk(once)).bytes == once.bytes);
  if (const auto* samples = std::get_if<RecordedSamples>(&chunk)) {
    std::ostringstream table;
    ExportCsv(*samples, table);
    FUZZ_CHECK(!table.str().empty());
  }
}

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(recording_chunk_fuzz) {
  using namespace palpate;
  fuzz::Input input({data, size});
  Payload payload{static_cast<ChunkType>(input.Take<std::uint16_t>())};
  const auto bytes = input.TakeRest();
  payload.bytes.assign(bytes.begin(), bytes.end());
  try {
    fuzz::CheckChunk(payload);
  } catch (const DamagedBytes&) {
  }
  return 0;
}
