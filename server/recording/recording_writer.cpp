#include "server/recording/recording_writer.h"

#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "common/wire/values.h"
#include "server/realtime/tick_timer.h"
#include "server/recording/recorded_messages.h"
#include "server/recording/recording_reader.h"
#include "server/recording/tick_layout.h"

namespace palpate {
namespace {

constexpr std::chrono::seconds kSyncPeriod{1};

class RecordingFile final : public RecordingOutput {
 public:
  RecordingFile(std::filesystem::path path, bool overwrite,
                std::function<std::chrono::steady_clock::time_point()> now)
      : file_(std::move(path), ReplacesIf(overwrite), 0666, Links::kRefused),
        now_(std::move(now)) {}

  void Append(std::string_view bytes) override {
    const auto now = now_();
    const bool had_name = file_.has_name();
    try {
      file_.Write(bytes);
      if (!file_.has_name()) {
        file_.TakeName();
        synced_ = now;
      } else if (now - synced_ > kSyncPeriod) {
        file_.Sync();
        synced_ = now;
      }
    } catch (const Error&) {
      // A file that got its name in this call is complete, even if a later step failed.
      if (had_name || !file_.has_name()) TakeBack();
      throw;
    }
    size_ += static_cast<off_t>(bytes.size());
  }

  void Sync() override { file_.Sync(); }

 private:
  // Cuts the file after its last complete chunk. If this fails, too, its length shows readers that
  // a chunk is cut.
  void TakeBack() {
    if (ftruncate(file_.descriptor(), size_) == 0) lseek(file_.descriptor(), size_, SEEK_SET);
  }

  NewFile file_;
  const std::function<std::chrono::steady_clock::time_point()> now_;
  off_t size_ = 0;
  std::chrono::steady_clock::time_point synced_{};
};

bool IsRecording(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return BeginsAsRecording(file);
}

// A recording that ends within seconds is of no use, and its client may notice too late.
void CheckRoom(const std::filesystem::path& path, std::uint64_t voxel_bytes) {
  struct statvfs disk {};
  const bool is_known =
      statvfs(std::filesystem::absolute(path).parent_path().c_str(), &disk) == 0 &&
      disk.f_blocks > 0;
  const std::uint64_t free_bytes = std::uint64_t{disk.f_bavail} * disk.f_frsize;
  if (!is_known || free_bytes >= kLeastRoomBytes + voxel_bytes) return;
  throw Error(
      ErrorKind::kDiskFull,
      "cannot record to " + path.string() + ": its disk has only " +
          std::to_string(free_bytes >> 20) + " MiB left, and a recording takes about 11 a " +
          "minute" +
          (voxel_bytes > 0 ? " and " + std::to_string(voxel_bytes >> 20) + " for the volume" : "") +
          "; make space, or name another folder");
}

}  // namespace

std::unique_ptr<RecordingOutput> CreateRecordingFile(
    const std::filesystem::path& path, bool overwrite, std::uint64_t voxel_bytes,
    std::function<std::chrono::steady_clock::time_point()> now) {
  if (overwrite && std::filesystem::exists(path) && !IsRecording(path)) {
    throw Error(ErrorKind::kConflict, path.string() +
                                          ": this is no recording, and stays; name "
                                          "another file");
  }
  CheckRoom(path, voxel_bytes);
  return std::make_unique<RecordingFile>(path, overwrite, std::move(now));
}

namespace {

// Of what comes between two ticks: many voxels, or many markers.
constexpr std::size_t kBytesPerChunk = std::size_t{4} << 20;

// Of damaged times, which may be any number.
std::int64_t Difference(std::int64_t a, std::int64_t b) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(a) - static_cast<std::uint64_t>(b));
}

template <class Message>
std::uint16_t AddChannel(mcap::Writer& file, const std::string& topic,
                         const mcap::Texts& metadata = {}) {
  const google::protobuf::Descriptor& message = *Message::descriptor();
  return file.AddChannel(topic, message.full_name(), SchemaOf(message), metadata);
}

}  // namespace

RecordingWriter::RecordingWriter(std::unique_ptr<RecordingOutput> output,
                                 const std::string& program)
    : output_(std::move(output)),
      file_(
          [this](std::string_view bytes) {
            output_->Append(bytes);
            counts_.bytes += bytes.size();
          },
          std::string(kLibraryStart) + program) {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const std::int64_t unix_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
  const std::int64_t monotonic_ns = MonotonicNowNs();
  time_from_unix_ns_ = monotonic_ns - unix_ns;
  // Until the first tick comes.
  time_ns_ = static_cast<std::uint64_t>(std::max(unix_ns, std::int64_t{0}));
  // The first hand. Others are /hand1/tick, /hand1/keyframe, ...
  const mcap::Texts hand = {{"hand", "0"},
                            {"frame", "D: mm, N; x right, y up, z towards the user"}};
  tick_ = AddChannel<v1::RecordedTick>(file_, kTickTopic, hand);
  scene_ = AddChannel<v1::RecordedScene>(file_, kSceneTopic);
  voxels_ = AddChannel<v1::RecordedVoxels>(file_, kVoxelsTopic);
  keyframe_ = AddChannel<v1::RecordedKeyframe>(file_, kKeyframeTopic, hand);
  event_ = AddChannel<v1::RecordedEvent>(file_, kEventTopic);
  clock_ = AddChannel<v1::RecordedClock>(file_, kClockTopic);
  file_.AddMetadata({kHeaderMetadata,
                     {{"program", program},
                      {"created_unix_ns", std::to_string(unix_ns)},
                      {"created_monotonic_ns", std::to_string(monotonic_ns)}}});
  file_.EndChunk();
}

void RecordingWriter::Append(const TickSample& sample) {
  SkipTo(sample.tick);
  next_tick_ = sample.tick + 1;
  const bool is_first = counts_.ticks + waiting_ticks_ == 0;
  time_ns_ = std::max(is_first ? 0 : time_ns_, LogTime(sample.time_ns));
  WriteWaiting();
  ConstantLayout layout;
  Put(RecordedTickOf(sample), layout);
  file_.AddMessage(tick_, time_ns_, layout.bytes());
  ++waiting_ticks_;
}

void RecordingWriter::Append(const RecordedScene& scene) {
  Wait(scene.tick, scene_, ToProto(scene).SerializeAsString());
}

void RecordingWriter::Append(const RecordedEdit& edit) {
  ForEachPart(edit, [&](const v1::RecordedVoxels& part) {
    Wait(edit.tick, voxels_, part.SerializeAsString());
  });
}

void RecordingWriter::Append(const RecordedEvent& event) {
  Wait(event.tick, event_, ToProto(event).SerializeAsString());
}

void RecordingWriter::Append(const RecordedKeyframe& keyframe) {
  Wait(keyframe.tick, keyframe_, ToProto(keyframe).SerializeAsString());
}

void RecordingWriter::Append(const RecordedClock& clock) {
  file_.AddMessage(clock_, time_ns_, ToProto(clock).SerializeAsString());
}

void RecordingWriter::SkipTo(std::uint64_t tick) {
  if (next_tick_ && tick < *next_tick_) {
    throw Error(ErrorKind::kInvalidArgument,
                "the ticks went back while recording: the haptic loop was restarted; start a new "
                "recording");
  }
  if (next_tick_) lost_ticks_ += tick - *next_tick_;
  next_tick_ = tick;
}

void RecordingWriter::EndChunk() {
  file_.EndChunk();
  counts_.ticks += std::exchange(waiting_ticks_, 0);
  counts_.lost_ticks = lost_ticks_;
}

void RecordingWriter::AppendEnd() {
  WriteWaiting();
  EndChunk();
  file_.AddMetadata({kEndMetadata,
                     {{"ticks", std::to_string(counts_.ticks)},
                      {"lost_ticks", std::to_string(counts_.lost_ticks)}}});
  file_.End();
  output_->Sync();
}

void RecordingWriter::Wait(std::uint64_t tick, std::uint16_t channel, std::string message) {
  SkipTo(tick);
  waiting_.emplace_back(channel, std::move(message));
}

void RecordingWriter::WriteWaiting() {
  for (const auto& [channel, message] : waiting_) {
    if (file_.chunk_bytes() > kBytesPerChunk) EndChunk();
    file_.AddMessage(channel, time_ns_, message);
  }
  waiting_.clear();
}

std::uint64_t RecordingWriter::LogTime(std::int64_t time_ns) const {
  const std::int64_t unix_ns = Difference(time_ns, time_from_unix_ns_);
  return unix_ns > 0 ? static_cast<std::uint64_t>(unix_ns) : 0;
}

}  // namespace palpate
