#include "server/recording/recording_reader.h"

#include <fstream>
#include <type_traits>
#include <utility>
#include <variant>

#include "common/error/error.h"
#include "server/recording/bytes.h"
#include "server/recording/chunk_codec.h"
#include "server/recording/chunk_frame.h"

namespace palpate {
namespace {

std::unique_ptr<std::istream> Open(const std::filesystem::path& file) {
  // Opening a pipe would block until a writer comes.
  std::error_code unknown;
  const std::filesystem::file_status status = std::filesystem::status(file, unknown);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    throw Error(ErrorKind::kInvalidArgument, file.string() + " is no file");
  }
  auto stream = std::make_unique<std::ifstream>(file, std::ios::binary);
  if (!*stream) {
    throw Error(ErrorKind::kNotFound, "cannot open the recording " + file.string());
  }
  return stream;
}

}  // namespace

RecordingReader::RecordingReader(const std::filesystem::path& file)
    : RecordingReader(Open(file), file.string()) {}

RecordingReader::RecordingReader(std::unique_ptr<std::istream> stream, std::string name)
    : stream_(std::move(stream)), name_(std::move(name)), header_(ReadHeader(*stream_, name_)) {}

std::optional<RecordedChunk> RecordingReader::Next() {
  if (complete_ || !stopped_because_.empty()) return std::nullopt;
  try {
    Payload payload;
    if (!ReadChunk(*stream_, next_number_, payload)) {
      StopBecause("was not closed");
      return std::nullopt;
    }
    RecordedChunk chunk = DecodeChunk(payload);
    Check(chunk);
    ++next_number_;
    return chunk;
  } catch (const DamagedBytes& damage) {
    complete_ = false;
    StopBecause("chunk " + std::to_string(next_number_) + " is " + damage.what());
    return std::nullopt;
  }
}

// Checks the order that RecordingWriter keeps.
void RecordingReader::Check(const RecordedChunk& chunk) {
  if (const auto* samples = std::get_if<RecordedSamples>(&chunk)) {
    StartAt(samples->front().tick);
    next_tick_ = samples->back().tick + 1;
    ticks_ += samples->size();
  } else if (const auto* gap = std::get_if<RecordedGap>(&chunk)) {
    StartAt(gap->first_tick);
    next_tick_ = gap->last_tick + 1;
    lost_ticks_ += gap->last_tick - gap->first_tick + 1;
  } else if (const auto* end = std::get_if<RecordedEnd>(&chunk)) {
    CheckEnd(*end);
  } else {
    std::visit(
        [&](const auto& event) {
          if constexpr (requires { event.tick; }) StartAt(event.tick);
        },
        chunk);
  }
}

void RecordingReader::CheckEnd(const RecordedEnd& end) {
  if (end.ticks != ticks_ || end.lost_ticks != lost_ticks_) {
    throw DamagedBytes("damaged: its counts do not fit");
  }
  if (stream_->peek() != std::istream::traits_type::eof()) {
    throw DamagedBytes("the end, but more follows");
  }
  complete_ = true;
}

void RecordingReader::StartAt(std::uint64_t tick) {
  if (next_tick_ && tick != *next_tick_) throw DamagedBytes("damaged: ticks are missing");
  next_tick_ = tick;
}

void RecordingReader::StopBecause(const std::string& what) {
  stopped_because_ = name_ + ": " + what + ", after " + std::to_string(ticks_) + " ticks";
}

}  // namespace palpate
