#include <cstdio>
#include <deque>
#include <fstream>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "server/lab/old_recording.h"
#include "server/lab/recording_command.h"
#include "server/recording/recording_writer.h"

namespace palpate::lab {
namespace {

class FileOutput final : public RecordingOutput {
 public:
  explicit FileOutput(const std::filesystem::path& file) : file_(file, std::ios::binary) {
    file_.exceptions(std::ios::failbit | std::ios::badbit);
  }
  void Append(std::string_view bytes) override { file_ << bytes; }
  void Sync() override { file_.flush(); }

 private:
  std::ofstream file_;
};

class Conversion {
 public:
  Conversion(const std::filesystem::path& file, const RecordingHeader& header)
      : output_(new FileOutput(file)), writer_(std::unique_ptr<RecordingOutput>(output_), header) {}

  void Take(OldRecording& recording) {
    while (std::optional<RecordedItem> item = recording.Next()) {
      if (const auto* samples = std::get_if<RecordedSamples>(&*item)) {
        for (const TickSample& sample : *samples) Take(sample);
      } else if (auto* event = std::get_if<RecordedEvent>(&*item)) {
        markers_.push_back(std::move(*event));
      } else {
        ahead_.push_back(std::move(*item));
      }
    }
    if (newest_) Write(std::numeric_limits<std::int64_t>::max());
    WriteAhead();
    for (const RecordedEvent& marker : markers_) writer_.Append(marker);  // there are no ticks
    // One that was not closed stays so.
    if (recording.stopped_because().empty()) return writer_.AppendEnd();
    writer_.EndChunk();
    output_->Sync();
  }

 private:
  // Before version 6, a marker stood at some tick nearby. Its time tells the right one, once the
  // next tick is known.
  void Take(const TickSample& sample) {
    if (newest_) Write(sample.time_ns);
    WriteAhead();
    newest_ = sample;
  }
  void Write(std::int64_t ended_ns) {
    for (; !markers_.empty() && markers_.front().time_ns < ended_ns; markers_.pop_front()) {
      markers_.front().tick = newest_->tick;
      writer_.Append(markers_.front());
    }
    writer_.Append(*newest_);
    newest_.reset();
    if (writer_.waiting_ticks() == kSamplesPerChunk) writer_.EndChunk();
  }
  // What comes before the next sample.
  void WriteAhead() {
    for (const RecordedItem& item : ahead_) {
      if (const auto* gap = std::get_if<RecordedGap>(&item)) writer_.SkipTo(gap->last_tick + 1);
      if (const auto* scene = std::get_if<RecordedScene>(&item)) writer_.Append(*scene);
      if (const auto* edit = std::get_if<RecordedEdit>(&item)) writer_.Append(*edit);
      if (const auto* keyframe = std::get_if<RecordedKeyframe>(&item)) writer_.Append(*keyframe);
    }
    ahead_.clear();
  }

  FileOutput* output_;  // the writer's
  RecordingWriter writer_;
  std::optional<TickSample> newest_;
  std::deque<RecordedEvent> markers_;
  std::vector<RecordedItem> ahead_;
};

}  // namespace

void ConvertRecording(const ExportOptions& options) {
  auto stream = std::make_unique<std::ifstream>(options.recording, std::ios::binary);
  if (!*stream) throw Error(ErrorKind::kNotFound, "cannot open " + options.recording.string());
  OldRecording recording(std::move(stream), options.recording.string());
  WriteWhole(
      options.output,
      [&](const std::filesystem::path& partial) {
        Conversion(partial, recording.header()).Take(recording);
      },
      ReplacesIf(options.overwrite));
  if (recording.stopped_because().empty()) return;
  std::fprintf(stderr, "palpate-lab: %s\n", recording.stopped_because().c_str());
}

}  // namespace palpate::lab
