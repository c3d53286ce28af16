#include "server/recording/recording_control.h"

#include <system_error>
#include <utility>
#include <variant>

#include "common/error/error.h"
#include "server/recording/recorded_scenes.h"
#include "server/servo/tick_computation.h"

namespace palpate {

RecordingOutline ReadOutline(RecordingReader& reader, const std::function<bool()>& cancelled) {
  // Of a marker without a text, too.
  constexpr std::size_t kBytesPerMarker = 16;
  RecordingOutline outline;
  std::size_t bytes = 0;
  while (std::optional<RecordedItem> item = reader.Next()) {
    if (cancelled()) throw Error(ErrorKind::kCancelled, "the replay was cancelled");
    if (const auto* samples = std::get_if<RecordedSamples>(&*item)) {
      outline.ticks += samples->size();
    }
    auto* const event = std::get_if<RecordedEvent>(&*item);
    if (!event) continue;
    bytes += event->marker.size() + kBytesPerMarker;
    if (bytes > kMostOutlineBytes) continue;
    // It comes before the sample of its tick.
    outline.markers.push_back({.tick = outline.ticks, .text = std::move(event->marker)});
  }
  return outline;
}

namespace {

namespace fs = std::filesystem;

// The memory that the previous volume keeps: its changed bricks, or all bricks if another volume
// was loaded.
std::uint64_t KeptBytes(const VolumeSnapshot& before, const VolumeSnapshot& volume,
                        std::span<const BrickChange> changes) {
  const bool is_new = before.loaded_revision() != volume.loaded_revision();
  if (is_new) return before.bricks().MemoryBytes();
  std::uint64_t bytes = 0;
  for (const BrickChange& change : changes) {
    const LeafPtr& leaf = before.bricks().At(change.brick);
    if (!leaf->is_constant()) bytes += leaf->Bytes();
  }
  return bytes;
}

// Of a volume that no file gives again, all voxels are stored, unless they are too many.
std::uint64_t StoredBytes(const RecordedScene& scene, const VolumeSnapshot& volume) {
  const std::uint64_t bytes = volume.bricks().MemoryBytes();
  return scene.reloadable || bytes > VoxelLog::kMaxBricksPerScene * sizeof(Brick) ? 0 : bytes;
}

}  // namespace

RecordingControl::RecordingControl(Session& session, Pump& pump, RecordingPaths paths,
                                   std::string program, const SafetyLimits& safety,
                                   const PassivityDevice& device, Report report)
    : session_(session),
      pump_(pump),
      paths_(std::move(paths)),
      program_(std::move(program)),
      safety_(safety),
      device_(device),
      report_(std::move(report)) {}

void RecordingControl::OnScene(const Scene& scene, std::span<const BrickChange> changes) {
  RecordedScene recorded =
      ToRecorded(scene, HashVolume(*scene.volume), kTickPeriodS, safety_, device_);
  // Destroyed after the lock is released, because freeing a volume takes time.
  std::shared_ptr<const VolumeSnapshot> before = scene.volume;
  const std::lock_guard lock(mutex_);
  if (recorder_) {
    recorder_->NoteScene(recorded, scene.volume,
                         volume_ ? KeptBytes(*volume_, *scene.volume, changes) : 0);
  }
  scene_ = std::move(recorded);
  volume_.swap(before);
}

RecordingStatus RecordingControl::Start(const std::string& path, bool overwrite) {
  const std::lock_guard command(commands_);
  CheckIdle();
  const std::filesystem::path file = paths_.save(path);
  const auto failed = [report = report_, file](const Error& error) {
    if (!report) return;
    report("the recording to " + file.string() + " ended early: " + error.what(), true);
  };
  const auto left_out = [report = report_, file](const std::string& why) {
    if (report) report("the recording to " + file.string() + " is incomplete: " + why, false);
  };
  std::uint64_t voxel_bytes = 0;
  {
    const std::lock_guard lock(mutex_);
    if (scene_ && volume_) voxel_bytes = StoredBytes(*scene_, *volume_);
  }
  const auto recorder = std::make_shared<Recorder>(
      CreateRecordingFile(file, overwrite, voxel_bytes), program_, failed, left_out);
  {
    const std::lock_guard lock(mutex_);
    if (scene_) recorder->NoteScene(*scene_, volume_);
    recorder_ = recorder;
    last_ = {.path = file.string()};
  }
  pump_.Subscribe(recorder);
  return status();
}

RecordingStatus RecordingControl::Stop() {
  const std::lock_guard command(commands_);
  const std::shared_ptr<Recorder> recorder = this->recorder();
  if (!recorder) throw Error(ErrorKind::kConflict, "nothing is recorded: start a recording first");
  const RecorderReport report = recorder->Stop();
  const std::lock_guard lock(mutex_);
  recorder_.reset();
  last_.counts = report.counts;
  last_.error = report.error;
  last_.left_out = report.left_out;
  return last_;
}

RecordingStatus RecordingControl::status() const {
  const std::lock_guard lock(mutex_);
  RecordingStatus status = last_;
  status.replay = replay_;
  if (!recorder_) return status;
  const RecorderReport report = recorder_->report();
  status.running = !report.error;
  status.counts = report.counts;
  status.error = report.error;
  status.left_out = report.left_out;
  return status;
}

void RecordingControl::SetReplay(std::optional<RunningReplay> replay) {
  const std::lock_guard lock(mutex_);
  replay_ = std::move(replay);
}

std::int64_t RecordingControl::Mark(const std::string& text) {
  const std::shared_ptr<Recorder> recorder = this->recorder();
  if (!recorder) throw Error(ErrorKind::kConflict, "nothing is recorded: start a recording first");
  if (const auto error = recorder->report().error) {
    throw Error(ErrorKind::kConflict,
                std::string("the recording has ended early: ") + error->what());
  }
  return recorder->Mark(text);
}

void RecordingControl::Replay(const std::string& path, const ViewerReplayOptions& options,
                              const ReplayReports& report, const std::function<bool()>& cancelled) {
  {
    const std::lock_guard command(commands_);
    CheckIdle();
    replaying_.store(true);
  }
  struct Running {
    RecordingControl& control;
    ~Running() {
      control.SetReplay({});
      control.replaying_.store(false);
    }
  } const running{*this};
  RecordingReader reader(paths_.open(path), path);
  RecordingOutline outline = OutlineOf(path, cancelled);
  const auto progress = [&](const ViewerReplayState& state) {
    SetReplay({{options.by, path, state.ticks, outline.ticks, options.speed}});
    report({state, outline.ticks, std::exchange(outline.markers, {})});
  };
  ReplayToViewers(session_, pump_, reader, options, progress, cancelled);
}

// A viewer that jumps to another place begins a new replay of the same file. Only its first replay
// waits until the whole file is read.
RecordingOutline RecordingControl::OutlineOf(const std::string& path,
                                             const std::function<bool()>& cancelled) {
  std::error_code error;
  KnownOutline now{.path = path,
                   .size_bytes = fs::file_size(path, error),
                   .modified = fs::last_write_time(path, error)};
  const bool is_same = now.path == known_.path && now.size_bytes == known_.size_bytes &&
                       now.modified == known_.modified;
  if (!error && is_same) return known_.outline;
  const MemoryClaim claim = session_.loader().budget->Claim("the replay", kMostItemBytes);
  RecordingReader reader(paths_.open(path), path);
  now.outline = ReadOutline(reader, cancelled);
  known_ = std::move(now);
  return known_.outline;
}

void RecordingControl::End() noexcept {
  const std::lock_guard command(commands_);
  if (const std::shared_ptr<Recorder> recorder = this->recorder()) recorder->Stop();
}

// A recording that ended by an error does not count as running.
void RecordingControl::CheckIdle() const {
  if (replaying_.load()) {
    throw Error(ErrorKind::kConflict, "a recording is being replayed: wait for its end");
  }
  const RecordingStatus now = status();
  if (now.running) {
    throw Error(ErrorKind::kConflict, "a recording to " + now.path + " runs: stop it first");
  }
}

std::shared_ptr<Recorder> RecordingControl::recorder() const {
  const std::lock_guard lock(mutex_);
  return recorder_;
}

}  // namespace palpate
