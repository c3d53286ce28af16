#include "server/session/series/series_player.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/client_paths/series_files.h"
#include "server/live_volume/volume_loader.h"
#include "server/log/log.h"
#include "server/volume/snapshot/brick_directory.h"

namespace palpate {
namespace {

std::string Text(const Vec3i& size) {
  return std::to_string(size.x()) + "x" + std::to_string(size.y()) + "x" + std::to_string(size.z());
}

// Reads the frames one after the other.
class Reader {
 public:
  Reader(const VolumeLoader& loader, std::span<const std::filesystem::path> files,
         const LoadRequest& request, const LoadProgress& progress, const LoadCancelled& cancelled,
         std::vector<std::string>& warnings, const BrickWork& work)
      : loader_(loader),
        files_(files),
        request_(request),
        progress_(progress),
        cancelled_(cancelled),
        warnings_(warnings),
        work_(work) {}

  LoadedSeries Read() {
    count_ = files_.size();
    claim_ = loader_.budget->Claim("the series", 0);
    ReadFrame(0);
    if (files_.size() == 1) {
      count_ = static_cast<std::size_t>(metadata_.frames);
      if (count_ < 2) {
        Refuse(files_[0].string() + ": there is one frame in it; a series needs two or more");
      }
      CheckFrames(count_);
      Claim(frame_memory_);
    }
    while (frames_.size() < count_) ReadFrame(frames_.size());
    return Finish();
  }

 private:
  // Claims memory for all later frames and the one being read, each as large as the largest so far.
  void Claim(const LoadMemory& frame) {
    frame_memory_.volume_bytes = std::max(frame_memory_.volume_bytes, frame.volume_bytes);
    frame_memory_.passing_bytes = std::max(frame_memory_.passing_bytes, frame.passing_bytes);
    ClaimRest(0);
  }

  // Reduces the claim by the bytes that the next frame has already made.
  void ClaimRest(std::uint64_t made_bytes) {
    claim_.Resize((count_ - frames_.size() + 1) * frame_memory_.volume_bytes +
                  frame_memory_.passing_bytes - std::min(made_bytes, frame_memory_.volume_bytes));
  }

  void ReadFrame(std::size_t frame) {
    LoadRequest request{.source = files_[files_.size() == 1 ? 0 : frame],
                        .spacing_mm = request_.spacing_mm,
                        .raw = request_.raw,
                        .grid = request_.grid,
                        .component = request_.component};
    request.frame = files_.size() == 1 ? static_cast<std::int64_t>(frame) : 0;
    const std::uint64_t before = work_.most_bytes();
    const auto progress = [&](std::string_view stage, double fraction) {
      ClaimRest(work_.most_bytes() - before);
      progress_("frame " + std::to_string(frame + 1) + ": " + std::string(stage),
                (static_cast<double>(frame) + fraction) / static_cast<double>(count_));
    };
    std::vector<std::string> warnings;
    LoadedVolume volume = loader_.Load(request, progress, cancelled_, warnings,
                                       [&](const Vec3i& size, const LoadMemory& memory) {
                                         CheckSize(request.source, size);
                                         Claim(memory);
                                       });
    // Keeps only the first frame's warnings: all frames have about the same.
    if (frame == 0) warnings_.insert(warnings_.end(), warnings.begin(), warnings.end());
    Take(volume, request.source);
    ClaimRest(0);
  }

  // Called before the voxels are read.
  void CheckSize(const std::string& source, const Vec3i& size) {
    if (!frames_.empty() && size != metadata_.size) RefuseSize(source, size);
  }

  [[noreturn]] void RefuseSize(const std::string& source, const Vec3i& size) const {
    Refuse(source + ": " + Text(size) + " voxels where the first frame has " +
           Text(metadata_.size) + "; all frames must have one size");
  }

  void Take(const LoadedVolume& volume, const std::string& source) {
    if (files_.size() > 1 && volume.metadata.frames != 1) {
      Refuse(source + ": the file has several frames; give only this file, or files with one " +
             "frame each");
    }
    if (frames_.empty()) {
      metadata_ = volume.metadata;
      // Frames share one lattice. A frame is saved like a volume that did not come from a .vdb
      // file.
      metadata_.grid_form = nullptr;
    } else if (volume.metadata.is_level_set != metadata_.is_level_set) {
      Refuse(source + ": level sets and densities cannot be frames of one series");
    } else if (volume.metadata.size != metadata_.size) {
      RefuseSize(source, volume.metadata.size);
    }
    metadata_.value_min = std::min(metadata_.value_min, volume.metadata.value_min);
    metadata_.value_max = std::max(metadata_.value_max, volume.metadata.value_max);
    // Finish sets the final background beyond the lattice, when the range of all frames is known.
    frames_.push_back(pool_->Share(volume.bricks, metadata_.size,
                                   static_cast<float>(volume.metadata.Background())));
    if (cancelled_()) throw Error(ErrorKind::kCancelled, "loading was cancelled");
  }

  LoadedSeries Finish() {
    pool_.emplace();
    const auto background = static_cast<float>(metadata_.Background());
    for (BrickDirectory& frame : frames_) frame = pool_->Share(frame, metadata_.size, background);
    metadata_.frames = static_cast<int>(frames_.size());
    const std::uint64_t bytes = MemoryBytes(frames_, metadata_.size);
    return {metadata_, std::move(frames_), bytes};
  }

  const VolumeLoader& loader_;
  const std::span<const std::filesystem::path> files_;
  const LoadRequest& request_;
  const LoadProgress& progress_;
  const LoadCancelled& cancelled_;
  std::vector<std::string>& warnings_;
  const BrickWork& work_;

  std::size_t count_ = 0;
  VolumeMetadata metadata_;
  std::vector<BrickDirectory> frames_;
  std::optional<BrickPool> pool_{std::in_place};
  LoadMemory frame_memory_;
  MemoryClaim claim_;
};

}  // namespace

LoadedSeries LoadSeries(const VolumeLoader& loader, std::span<const std::filesystem::path> files,
                        const LoadRequest& request, const LoadProgress& progress,
                        const LoadCancelled& cancelled, std::vector<std::string>& warnings,
                        const BrickWork& work) {
  return Reader(loader, files, request, progress, cancelled, warnings, work).Read();
}

BrickDirectory Blend(const BrickDirectory& from, const BrickDirectory& to, double share,
                     const std::function<void(std::uint64_t bytes)>& bytes_known) {
  std::vector<BrickChange> changes = from.ChangesTo(to);
  if (bytes_known) {
    const Vec3i last = from.brick_count() - Vec3i::Ones();
    bytes_known(changes.size() * Leaf::Bytes(LeafType::kFloat) +
                BrickDirectory::BlockBytes(Vec3i::Zero(), last));
  }
  for (BrickChange& change : changes) {
    const Brick start = from.At(change.brick)->Floats();
    const Brick end = change.values->Floats();
    Brick blended;
    for (int n = 0; n < kBrickVoxels; ++n) {
      blended[n] = static_cast<float>((1.0 - share) * start[n] + share * end[n]);
    }
    change.values = Leaf::Of(LeafType::kFloat, blended);
  }
  return from.With(changes, 1);
}

namespace {

constexpr std::chrono::nanoseconds kInterval{1'000'000'000 / SeriesPlayer::kMostPerSecond};
// A paused player checks this often whether another volume was loaded.
constexpr std::chrono::milliseconds kIdleInterval{100};

[[noreturn]] void FailWithoutSeries() {
  throw Error(ErrorKind::kConflict, "no series is loaded: load one first");
}

// The checks also refuse NaN.
void CheckControl(const ControlSeriesRequest& control, std::size_t frames) {
  const auto last = static_cast<double>(frames - 1);
  if (control.position_frames &&
      !(*control.position_frames >= 0.0 && *control.position_frames <= last)) {
    Refuse(fmt::format("position_frames {} is not within 0 to {}", *control.position_frames, last));
  }
  if (control.rate_hz && !(std::abs(*control.rate_hz) > 0.0 &&
                           std::abs(*control.rate_hz) <= SeriesPlayer::kGreatestRateHz)) {
    Refuse(fmt::format("rate_hz {} is not within -1000 to 1000 without 0", *control.rate_hz));
  }
}

}  // namespace

// Only the player's thread writes it, except for the atomic.
struct SeriesPlayer::Series {
  std::vector<BrickDirectory> loaded;  // the frames as loaded
  std::vector<BrickDirectory> frames;  // the frames with their edits
  Vec3i size;
  std::uint64_t loaded_revision = 0;
  std::vector<std::uint64_t> edited_bytes;  // of each frame
  std::atomic<std::uint64_t> memory_bytes = 0;
  double shown = 0.0;
  std::uint64_t shown_revision = 0;  // a later revision is an edit
  bool said_no_room = false;         // the missing memory for blends was already logged
  bool said_slow = false;            // and that frames are left out
};

SeriesPlayer::SeriesPlayer(Session& session, std::function<Clock::time_point()> now)
    : session_(session), now_(std::move(now)), thread_([this] { Run(); }) {}

void SeriesPlayer::Stop() noexcept {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  was_taken_.notify_all();
  if (thread_.joinable()) thread_.join();
}

VolumeState SeriesPlayer::Load(std::span<const std::filesystem::path> files,
                               const LoadRequest& request, const LoadProgress& progress,
                               const LoadCancelled& cancelled, const SettingsUpdate& settings) {
  const std::unique_lock loading = session_.BeginLoad();
  session_.CheckSettings(request, settings);
  session_.store().RequireSaved(request.discards_edits);
  std::vector<std::string> warnings;
  const BrickWork work;
  LoadedSeries loaded =
      LoadSeries(session_.loader(), files, request, progress, cancelled, warnings, work);
  for (const std::string& warning : warnings) LogWarning("{}", warning);
  loaded.metadata.source = request.title.empty() ? files.front().string() : request.title;
  loaded.metadata.warnings = WarningsForClients(warnings, files.front().string());
  loaded.metadata.reloadable = false;  // each file has its own range of values
  loaded.metadata.series_position_frames = 0.0;
  const auto tell = [&](std::string_view stage, double fraction) {
    progress(stage, fraction);
    if (cancelled()) throw Error(ErrorKind::kCancelled, "loading was cancelled");
  };
  tell("publishing", 1.0);

  auto series = std::make_shared<Series>();
  series->size = loaded.metadata.size;
  series->memory_bytes = loaded.memory_bytes;
  series->edited_bytes.resize(loaded.frames.size());
  series->frames = loaded.frames;
  series->loaded = std::move(loaded.frames);
  // Another thread frees the rest, whether the series is published or not.
  struct Retire {
    ~Retire() { retired.Add(std::move(series)); }
    RetiredVolumes& retired;
    std::shared_ptr<Series>& series;
  };
  const Retire retire{session_.retired(), series};
  const VolumeState state = session_.PublishVolume(request, loaded.metadata, series->frames.front(),
                                                   loaded.memory_bytes, settings, tell);
  series->loaded_revision = series->shown_revision = state.volume->revision();

  const std::lock_guard lock(mutex_);
  series_.swap(series);
  position_ = 0.0;
  playing_ = loop_ = interpolate_ = false;
  rate_hz_ = SeriesState{}.rate_hz;
  return state;
}

SeriesState SeriesPlayer::state() const {
  const VolumeState volume = session_.shown().volume();
  const std::lock_guard lock(mutex_);
  SeriesState state = StateLocked(volume);
  if (volume.replayed) {
    const auto position = volume.volume->metadata().series_position_frames;
    state.position_frames = position.value_or(state.position_frames);
    state.playing = false;
    state.replayed = true;
  }
  return state;
}

SeriesState SeriesPlayer::StateLocked(const VolumeState& volume) const {
  if (!series_ || series_->loaded_revision != volume.volume->loaded_revision()) {
    FailWithoutSeries();
  }
  return {.frames = static_cast<std::uint32_t>(series_->loaded.size()),
          .position_frames = ShownPosition(),
          .playing = playing_,
          .rate_hz = rate_hz_,
          .loop = loop_,
          .interpolate = interpolate_,
          .memory_bytes = series_->memory_bytes,
          .volume_revision = volume.volume->revision()};
}

void SeriesPlayer::Take(const ControlSeriesRequest& control) {
  CheckControl(control, series_->loaded.size());
  const Clock::time_point now = now_();
  Advance(now);
  const bool starts = control.playing.value_or(false) && !playing_;
  rate_hz_ = control.rate_hz.value_or(rate_hz_);
  loop_ = control.loop.value_or(loop_);
  interpolate_ = control.interpolate.value_or(interpolate_);
  playing_ = control.playing.value_or(playing_);
  position_ = control.position_frames.value_or(position_);
  const auto last = static_cast<double>(series_->loaded.size() - 1);
  if (!loop_) position_ = std::min(position_, last);
  if (starts && !control.position_frames && !loop_) {
    if (rate_hz_ > 0.0 && position_ == last) position_ = 0.0;
    // The last frame lasts as long as the others.
    if (rate_hz_ < 0.0 && position_ == 0.0) position_ = std::nextafter(last + 1.0, 0.0);
  }
  advanced_at_ = now;
  sought_ = sought_ || control.position_frames;
  changed_ = true;
}

SeriesControlled SeriesPlayer::Control(const ControlSeriesRequest& control) {
  const VolumeState volume = session_.volume();
  std::unique_lock lock(mutex_);
  StateLocked(volume);  // throws if there is no series
  Take(control);
  const std::uint64_t command = ++commands_;
  wake_.notify_all();
  const std::shared_ptr<Series> series = series_;
  was_taken_.wait(lock, [&] { return stop_ || series_ != series || taken_.command >= command; });
  if (stop_ || series_ != series) {
    throw Error(ErrorKind::kConflict, "the series ended before the change was felt");
  }
  SeriesControlled controlled{StateLocked(volume), taken_.revisions.scene};
  controlled.series.position_frames = taken_.position;
  controlled.series.volume_revision = taken_.revisions.volume;
  return controlled;
}

void SeriesPlayer::Advance(Clock::time_point now) {
  const double elapsed_s = std::chrono::duration<double>(now - advanced_at_).count();
  advanced_at_ = now;
  if (!series_ || !playing_) return;
  const auto frames = static_cast<double>(series_->loaded.size());
  position_ += rate_hz_ * elapsed_s;
  if (loop_) {
    position_ = std::fmod(position_, frames);
    if (position_ < 0.0) position_ += frames;
    // A tiny negative number plus the number of frames may round to the number of frames.
    if (position_ >= frames) position_ = 0.0;
    return;
  }
  playing_ = rate_hz_ > 0.0 ? position_ < frames - 1.0 : position_ > 0.0;
  if (!playing_) position_ = std::clamp(position_, 0.0, frames - 1.0);
}

double SeriesPlayer::ShownPosition() const {
  const double position = std::min(position_, static_cast<double>(series_->loaded.size() - 1));
  return interpolate_ ? position : std::floor(position);
}

std::shared_ptr<SeriesPlayer::Series> SeriesPlayer::WaitForWork(
    std::unique_lock<std::mutex>& lock) {
  const auto ready = [this] { return stop_ || changed_; };
  if (playing_) {
    wake_.wait_for(lock, kInterval, ready);
  } else {
    wake_.wait_for(lock, kIdleInterval, ready);
  }
  changed_ = false;
  return stop_ ? nullptr : series_;
}

void SeriesPlayer::Run() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    const std::shared_ptr<Series> series = WaitForWork(lock);
    if (!series) continue;
    if (!std::exchange(sought_, false)) Advance(now_());
    const double position = ShownPosition();
    const std::uint64_t command = commands_;
    lock.unlock();
    const Clock::time_point started = Clock::now();
    std::optional<EditedRevisions> shown;
    try {
      shown = Show(*series, position);
    } catch (const std::exception& error) {
      LogError("the series ends: {}", error.what());
    }
    const bool has_ball = session_.ball().felt_radius_mm > 0.0;
    lock.lock();
    if (shown) taken_ = {command, position, *shown};
    SayIfSlow(*series, Clock::now() - started, has_ball);
    if (!shown && series_ == series) session_.retired().Add(std::exchange(series_, nullptr));
    was_taken_.notify_all();
    // Limits the rate of frames, however often a client calls Control.
    wake_.wait_until(lock, started + kInterval, [this] { return stop_; });
  }
}

void SeriesPlayer::SayIfSlow(Series& series, Clock::duration took, bool has_ball) {
  const double took_s = std::chrono::duration<double>(took).count();
  const bool is_slow = took > kInterval && took_s * std::abs(rate_hz_) > 1.0;
  if (!playing_ || !is_slow || std::exchange(series.said_slow, true)) return;
  LogWarning("the series leaves out frames: one took {:.0f} ms{}", 1e3 * took_s,
             has_ball ? ", with a ball at the tip" : "");
}

bool SeriesPlayer::KeepEdits(Series& series, const VolumeSnapshot& present) {
  if (present.loaded_revision() != series.loaded_revision) return false;
  const bool is_edited = present.revision() != series.shown_revision;
  const bool is_frame = series.shown == std::floor(series.shown);
  series.shown_revision = present.revision();
  if (!is_edited || !is_frame) return true;
  const auto frame = static_cast<std::size_t>(series.shown);
  const BrickDirectory& edited = present.bricks();
  std::uint64_t bytes = 0;
  for (const BrickChange& change : series.loaded[frame].ChangesTo(edited)) {
    if (!change.values->is_constant()) bytes += change.values->Bytes();
  }
  series.memory_bytes += bytes - std::exchange(series.edited_bytes[frame], bytes);
  series.frames[frame] = edited;
  return true;
}

// Returns none if there is no memory for the blend. Then the frame before the blend is shown.
std::optional<BrickDirectory> SeriesPlayer::TryBlend(Series& series, std::size_t frame,
                                                     double share, MemoryClaim& claim) {
  try {
    return Blend(series.frames[frame], series.frames[frame + 1], share, [&](std::uint64_t bytes) {
      claim = session_.loader().budget->Claim("a frame in between", bytes);
    });
  } catch (const Error& error) {
    if (!std::exchange(series.said_no_room, true)) {
      LogWarning("the series is not interpolated: {}", error.what());
    }
    return std::nullopt;
  }
}

std::optional<EditedRevisions> SeriesPlayer::Show(Series& series, double position) {
  const VolumeState before = session_.volume();
  if (before.volume->loaded_revision() != series.loaded_revision) return std::nullopt;
  if (position == series.shown) {
    return EditedRevisions{before.volume->revision(), before.scene_revision};
  }
  const auto frame = static_cast<std::size_t>(position);
  const double share = position - static_cast<double>(frame);
  VolumeStore& store = session_.store();
  bool goes_on = true;
  MemoryClaim claim;
  std::optional<BrickDirectory> blended;
  if (share > 0.0) {
    // Checked before the blend, in a transaction of its own: others can edit during the blend.
    store.Edit([&](const auto& present) {
      goes_on = KeepEdits(series, *present);
      return std::vector<BrickChange>();
    });
    if (!goes_on) return std::nullopt;
    blended = TryBlend(series, frame, share, claim);
    claim = {};  // the bricks are now counted themselves
  }
  const EditedRevisions shown = store.Edit([&](const auto& present) {
    goes_on = KeepEdits(series, *present);
    if (!goes_on) return VolumeChange();
    series.shown = position;
    VolumeChange change(present->bricks().ChangesTo(blended ? *blended : series.frames[frame]));
    change.series_position_frames = blended ? position : static_cast<double>(frame);
    return change;
  });
  if (!goes_on) return std::nullopt;
  series.shown_revision = shown.volume;
  return shown;
}

}  // namespace palpate
