#include "server/recording/recording_writer.h"

#include <chrono>
#include <utility>

#include "common/error/error.h"
#include "server/realtime/tick_timer.h"
#include "server/recording/chunk_codec.h"
#include "server/recording/chunk_frame.h"

namespace palpate {
namespace {

// Counts the samples at the start that have consecutive ticks and fit into one chunk.
std::size_t Consecutive(std::span<const TickSample> samples) {
  std::size_t n = 1;
  while (n < samples.size() && n < kSamplesPerChunk && samples[n].tick == samples[0].tick + n) ++n;
  return n;
}

}  // namespace

RecordingWriter::RecordingWriter(std::unique_ptr<RecordingOutput> output,
                                 const std::string& program)
    : output_(std::move(output)) {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const std::string header = FrameHeader(
      {.created_unix_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count(),
       .created_monotonic_ns = MonotonicNowNs(),
       .program = program});
  output_->Append(header);
  counts_.bytes = header.size();
}

void RecordingWriter::AppendSamples(std::span<const TickSample> samples) {
  while (!samples.empty()) {
    SkipTo(samples[0].tick);
    const std::size_t count = Consecutive(samples);
    Write(RecordedSamples(samples.begin(), samples.begin() + count));
    counts_.ticks += count;
    next_tick_ = samples[0].tick + count;
    samples = samples.subspan(count);
  }
}

void RecordingWriter::SkipTo(std::uint64_t tick) {
  if (next_tick_ && tick < *next_tick_) {
    throw Error(ErrorKind::kInvalidArgument,
                "the ticks went back while recording: the haptic loop was restarted; start a new "
                "recording");
  }
  if (next_tick_ && tick > *next_tick_) {
    Write(RecordedGap{.first_tick = *next_tick_, .last_tick = tick - 1});
    counts_.lost_ticks += tick - *next_tick_;
  }
  next_tick_ = tick;
}

void RecordingWriter::AppendEnd() {
  Write(RecordedEnd{.ticks = counts_.ticks, .lost_ticks = counts_.lost_ticks});
  output_->Sync();
}

void RecordingWriter::AppendEvent(std::uint64_t tick, const RecordedChunk& event) {
  SkipTo(tick);
  Write(event);
}

void RecordingWriter::Write(const RecordedChunk& chunk) {
  const std::string bytes = FrameChunk(EncodeChunk(chunk), next_number_);
  output_->Append(bytes);
  ++next_number_;
  counts_.bytes += bytes.size();
}

}  // namespace palpate
