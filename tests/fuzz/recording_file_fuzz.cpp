// Any bytes as a recording, read to its end, and its stylus' path. Its checksums and the
// numbers of its chunks are made to fit where the first byte is even: they would keep
// all but the corpus out.
#include <xxhash.h>

#include <memory>
#include <sstream>
#include <string>

#include "common/error/error.h"
#include "server/recording/recorded_path.h"
#include "server/recording/recording_reader.h"
#include "tests/fuzz/fuzz_input.h"

namespace palpate::fuzz {
namespace {

constexpr std::size_t kHeaderBytes = 24;  // before the program's name
constexpr std::size_t kChunkBytes = 28;   // before the payload
constexpr std::size_t kLongestPath = 5000;

template <typename Number>
Number At(const std::string& file, std::size_t offset) {
  Number number;
  std::memcpy(&number, &file[offset], sizeof number);
  return number;
}

void Put(std::string& file, std::size_t offset, std::uint64_t number) {
  std::memcpy(&file[offset], &number, sizeof number);
}

std::uint64_t Checksum(const std::string& file, std::size_t begin, std::size_t end) {
  return XXH3_64bits(file.data() + begin, end - begin);
}

// As chunk_frame.h describes them.
void MakeChecksumsFit(std::string& file) {
  if (file.size() < kHeaderBytes) return;
  std::size_t at = kHeaderBytes + At<std::uint32_t>(file, 12);
  if (at + sizeof(std::uint64_t) > file.size()) return;
  Put(file, at, Checksum(file, 0, at));
  at += sizeof(std::uint64_t);
  for (std::uint64_t number = 0; at + kChunkBytes <= file.size(); ++number) {
    const std::size_t end = at + kChunkBytes + At<std::uint32_t>(file, at + 24);
    if (end > file.size()) return;
    Put(file, at + 8, number);
    Put(file, at, Checksum(file, at + 8, end));
    at = end;
  }
}

void ReadRecording(const std::string& file) {
  RecordingReader reader(std::make_unique<std::istringstream>(file), "file");
  std::uint64_t ticks = 0;
  while (const auto chunk = reader.Next()) {
    if (const auto* samples = std::get_if<RecordedSamples>(&*chunk)) ticks += samples->size();
  }
  FUZZ_CHECK(reader.ticks() == ticks);
  FUZZ_CHECK(reader.complete() == reader.stopped_because().empty());
  FUZZ_CHECK(!reader.Next());
}

void ReadPath(const std::string& file) {
  RecordingReader reader(std::make_unique<std::istringstream>(file), "file");
  const auto path = ReadStylusPath(reader, "file", kLongestPath);
  FUZZ_CHECK(!path.empty() && path.size() <= kLongestPath);
  for (const DeviceState& state : path) FUZZ_CHECK(state.p_DHip_mm.allFinite());
}

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(recording_file_fuzz) {
  using namespace palpate;
  fuzz::Input input({data, size});
  const bool repairs = input.Take<std::uint8_t>() % 2 == 0;
  const auto bytes = input.TakeRest();
  std::string file(bytes.begin(), bytes.end());
  if (repairs) fuzz::MakeChecksumsFit(file);
  try {
    fuzz::ReadRecording(file);
    fuzz::ReadPath(file);
  } catch (const Error&) {
  }
  return 0;
}
