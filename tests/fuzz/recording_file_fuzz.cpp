// Any bytes as a recording: read to its end, its table, and its stylus' path. Checksums are taken
// out, which is allowed: they would keep all but the corpus out.
#include <cstring>
#include <memory>
#include <sstream>
#include <string>

#include "common/error/error.h"
#include "server/recording/csv_export.h"
#include "server/recording/mcap.h"
#include "server/recording/recorded_path.h"
#include "server/recording/recording_reader.h"
#include "tests/fuzz/fuzz_input.h"

namespace palpate::fuzz {
namespace {

constexpr std::size_t kLongestPath = 5000;

void RemoveChecksums(std::string& file) {
  const auto remove = [&](std::size_t at, std::size_t end) {
    if (at + 4 <= end) std::memset(&file[at], 0, 4);
  };
  for (std::size_t at = mcap::kMagic.size(); at + mcap::kRecordHeadBytes <= file.size();) {
    std::uint64_t bytes = 0;
    std::memcpy(&bytes, &file[at + 1], sizeof bytes);
    const auto opcode = static_cast<mcap::Opcode>(file[at]);
    at += mcap::kRecordHeadBytes;
    if (bytes > file.size() - at) return;
    const std::size_t end = at + bytes;
    if (opcode == mcap::Opcode::kChunk) remove(at + 24, end);
    if (opcode == mcap::Opcode::kDataEnd) remove(at, end);
    if (opcode == mcap::Opcode::kFooter) remove(at + 16, end);
    at = end;
  }
}

void ReadRecording(const std::string& file) {
  RecordingReader reader(std::make_unique<std::istringstream>(file), "file");
  std::uint64_t ticks = 0;
  while (const auto item = reader.Next()) {
    if (const auto* samples = std::get_if<RecordedSamples>(&*item)) ticks += samples->size();
  }
  FUZZ_CHECK(reader.ticks() == ticks);
  FUZZ_CHECK(reader.complete() == reader.stopped_because().empty());
  FUZZ_CHECK(!reader.Next());
}

void ReadTable(const std::string& file) {
  RecordingReader reader(std::make_unique<std::istringstream>(file), "file");
  std::ostringstream table;
  ExportCsv(reader, table);
  FUZZ_CHECK(!table.str().empty());
}

void ReadPath(const std::string& file) {
  RecordingReader reader(std::make_unique<std::istringstream>(file), "file");
  const auto path = ReadStylusPath(reader, "file", kLongestPath);
  FUZZ_CHECK(!path.empty() && path.size() <= kLongestPath);
  for (const DeviceState& state : path) FUZZ_CHECK(state.p_MHip_mm.allFinite());
}

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(recording_file_fuzz) {
  using namespace palpate;
  std::string file(data, data + size);
  fuzz::RemoveChecksums(file);
  try {
    fuzz::ReadRecording(file);
    fuzz::ReadTable(file);
    fuzz::ReadPath(file);
  } catch (const Error&) {
  }
  return 0;
}
