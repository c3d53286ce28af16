#include "server/recording/viewer_replay.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "common/error/error.h"
#include "server/recording/recorded_volumes.h"
#include "server/recording/shown_samples.h"
#include "server/recording/voxel_log.h"

namespace palpate {
namespace {

constexpr std::chrono::milliseconds kReplayPollPeriod{2};
constexpr std::chrono::milliseconds kReportPeriod{100};
// How much of the recording is read ahead.
constexpr double kAheadMs = 500.0;
constexpr std::size_t kMaxEventsAhead = 1024;
constexpr std::size_t kMaxBricksAhead = (std::size_t{128} << 20) / sizeof(Brick);
// Longer times without ticks are shortened to this time.
constexpr std::uint64_t kLongestPauseMs = 1000;

// A recording begins with its scene, or has it a few ticks later.
constexpr double kLatestSceneMs = 10'000.0;

// An event between two samples.
struct Event {
  double position_ms = 0.0;
  std::vector<RecordedEdit> edits{};
  std::optional<RecordedScene> scene{};
  std::string marker{};
  std::uint64_t lost_ticks = 0;
};

VolumePlace PlaceOf(const RecordedScene& scene, const VolumeMetadata& volume) {
  VolumePlace registration;
  registration.X_DW = scene.X_DI * volume.WorldFromIndex().Inverse();
  registration.device_mm_per_volume_mm =
      std::cbrt(std::abs(registration.X_DW.linear.determinant()));
  const double scale = registration.device_mm_per_volume_mm;
  if (!(std::isfinite(scale) && scale > 0.0 && registration.X_DW.translation.allFinite())) {
    throw Error(ErrorKind::kInvalidArgument, "the recording's place of the volume is no place");
  }
  registration.p_DCenter_mm = registration.X_DW.Apply(VolumeCenterMm(volume));
  registration.R_DW = Eigen::Quaterniond(Mat3(registration.X_DW.linear / scale)).normalized();
  return registration;
}

class ViewerReplay {
 public:
  ViewerReplay(Session& session, Pump& pump, RecordingReader& reader,
               const ViewerReplayOptions& options, const ViewerReplayProgress& progress,
               const std::function<bool()>& cancelled)
      : session_(session),
        pump_(pump),
        reader_(reader),
        first_tick_(options.first_tick),
        ahead_ms_(kAheadMs * std::max(1.0, options.speed)),
        progress_(progress),
        cancelled_(cancelled),
        loading_(session.BeginLoad()),
        hold_(session.store()),
        before_(session.volume()),
        follower_([this](const RecordedScene& scene) { return StartVolume(scene); }),
        shown_(std::make_shared<ShownSamples>(options.speed)) {}

  void Run() {
    CheckStart();
    try {
      session_.SetForcesOff(true);
      pump_.Replace(shown_);
      Play();
    } catch (...) {
      Restore();
      throw;
    }
    Restore();
  }

 private:
  // How the volume is at the first tick, until it is shown so.
  struct Start {
    std::shared_ptr<const VolumeSnapshot> volume{};
    std::optional<RecordedScene> scene{};
  };

  // Changes nothing in the session, so it may throw without a Restore.
  void CheckStart() {
    while (!IsSceneWaiting() && read_ms_ < kLatestSceneMs && events_.size() < kMaxEventsAhead &&
           ReadOne()) {
    }
    if (!IsSceneWaiting()) {
      throw Error(ErrorKind::kInvalidArgument,
                  "the recording does not begin with a scene: it was cut, or is damaged");
    }
    FollowNewest();
    if (!start_.volume) throw *follower_.error();
    SkipToFirstTick();
  }

  // Reads what comes before the first tick to show, and keeps only where it leads.
  void SkipToFirstTick() {
    while (read_ticks_ <= first_tick_ && first_tick_ > 0) {
      for (const Event& event : events_) lost_ticks_ += event.lost_ticks;
      events_.clear();
      if (!ReadOne()) {
        throw Error(ErrorKind::kInvalidArgument, "the recording has only " +
                                                     std::to_string(read_ticks_) +
                                                     " ticks: start at an earlier one");
      }
      if (IsSceneWaiting()) FollowNewest();
    }
  }

  // The newest scene is where the replay starts, as far as its volume is known.
  void FollowNewest() {
    Event& event = events_.back();
    for (RecordedEdit& edit : event.edits) follower_.Take(std::move(edit));
    event.edits.clear();
    if (auto volume = follower_.Follow(*event.scene)) {
      start_ = {std::move(volume), std::move(event.scene)};
    }
    event.scene.reset();
  }

  bool IsSceneWaiting() const { return !events_.empty() && events_.back().scene; }

  // The replay can use only the volume that is loaded now.
  std::shared_ptr<const VolumeSnapshot> StartVolume(const RecordedScene& scene) {
    if (std::exchange(started_, true)) {
      throw Error(ErrorKind::kConflict,
                  "the recording continues with another volume: " + scene.volume_source);
    }
    return before_.volume;
  }

  void Play() {
    auto report_at = std::chrono::steady_clock::now();
    for (bool more = true; more || shown_->waiting() > 0 || !events_.empty();) {
      while (more && IsRoomAhead()) more = ReadOne();
      if (!more && shown_->waiting() == 0) position_is_end_ = true;
      ApplyDue();
      if (std::chrono::steady_clock::now() >= report_at) {
        Report("");
        report_at += kReportPeriod;
      }
      CheckWanted();
      std::this_thread::sleep_for(kReplayPollPeriod);
    }
    Report("");
  }

  bool IsRoomAhead() const { return !IsFull() && read_ms_ - shown_->position_ms() < ahead_ms_; }

  bool IsFull() const {
    std::size_t bricks = 0;
    for (const Event& event : events_) {
      for (const RecordedEdit& edit : event.edits) bricks += edit.BrickCount();
    }
    return events_.size() >= kMaxEventsAhead || bricks >= kMaxBricksAhead;
  }

  void CheckWanted() const {
    if (cancelled_()) throw Error(ErrorKind::kCancelled, "the replay was cancelled");
  }

  // False at the end.
  bool ReadOne() {
    CheckWanted();
    // The session counts bricks when they are applied.
    const MemoryClaim claim = session_.loader().budget->Claim("the replay", kMostItemBytes);
    std::optional<RecordedItem> item = reader_.Next();
    if (!item) return false;
    if (auto* samples = std::get_if<RecordedSamples>(&*item)) {
      for (const TickSample& sample : *samples) Place(sample);
    } else if (auto* edit = std::get_if<RecordedEdit>(&*item)) {
      edits_.push_back(std::move(*edit));
    } else if (auto* scene = std::get_if<RecordedScene>(&*item)) {
      events_.push_back({.position_ms = NextMs(), .edits = std::exchange(edits_, {})});
      events_.back().scene = std::move(*scene);
    } else if (auto* marker = std::get_if<RecordedEvent>(&*item)) {
      events_.push_back({.position_ms = NextMs(), .marker = std::move(marker->marker)});
    } else if (auto* gap = std::get_if<RecordedGap>(&*item)) {
      const std::uint64_t ticks = gap->last_tick - gap->first_tick + 1;
      // The first tick is shown at once, whatever was lost before it.
      if (missed_ticks_) read_ms_ += static_cast<double>(std::min(ticks, kLongestPauseMs));
      events_.push_back({.position_ms = read_ms_, .lost_ticks = ticks});
    }
    return true;
  }

  // Of the next sample. Before the first sample, at once.
  double NextMs() const { return missed_ticks_ ? read_ms_ + 1.0 : read_ms_; }

  void Place(const TickSample& sample) {
    if (read_ticks_++ < first_tick_) return;
    const std::uint64_t missed = missed_ticks_ ? sample.missed_ticks - *missed_ticks_ : 0;
    // The first one is shown at once, however slow the replay is.
    if (missed_ticks_) read_ms_ += static_cast<double>(1 + std::min(missed, kLongestPauseMs));
    missed_ticks_ = sample.missed_ticks;
    shown_->Add(sample, read_ms_);
  }

  void ApplyDue() {
    // CheckStart has already found the first scene's volume.
    if (const Start start = std::exchange(start_, {}); start.volume) {
      Show(*start.volume);
      Put(*start.scene);
    }
    // The samples behind the events are read only when these have made room.
    const bool all = position_is_end_ || (shown_->waiting() == 0 && IsFull());
    while (!events_.empty() && (all || events_.front().position_ms <= shown_->position_ms())) {
      Event event = std::move(events_.front());
      events_.pop_front();
      lost_ticks_ += event.lost_ticks;
      if (!event.marker.empty()) Report(event.marker);
      if (event.scene) Begin(event);
    }
  }

  void Begin(Event& event) {
    for (RecordedEdit& edit : event.edits) follower_.Take(std::move(edit));
    if (const auto volume = follower_.Follow(*event.scene)) {
      Show(*volume);
      Put(*event.scene);
    }
  }

  void Show(const VolumeSnapshot& volume) {
    session_.store().Edit(
        [&](const auto& present) { return present->bricks().ChangesTo(volume.bricks()); });
  }

  void Put(const RecordedScene& scene) {
    const VolumeState live = session_.volume();
    if (live.X_DI == scene.X_DI) return;
    const VolumePlace registration = PlaceOf(scene, live.volume->metadata());
    // Compares with the last placement, because the live one may differ by rounding.
    if (placed_ == registration.X_DW) return;
    placed_ = registration.X_DW;
    session_.Move([&](const VolumeState&) { return registration; }, {}, /*keep=*/false);
  }

  // Switches forces on again even if the voxels cannot be restored.
  void Restore() {
    pump_.Replace(nullptr);
    try {
      Show(*before_.volume);
      const AffineMap live = session_.volume().registration.X_DW;
      const AffineMap& wanted = before_.registration.X_DW;
      if (live.linear != wanted.linear || live.translation != wanted.translation) {
        session_.Move([&](const VolumeState&) { return before_.registration; });
      }
    } catch (...) {
      session_.SetForcesOff(false);
      throw;
    }
    session_.SetForcesOff(false);
  }

  void Report(const std::string& marker) {
    progress_(
        {.ticks = first_tick_ + shown_->passed(), .lost_ticks = lost_ticks_, .marker = marker});
  }

  Session& session_;
  Pump& pump_;
  RecordingReader& reader_;
  const std::uint64_t first_tick_;
  const double ahead_ms_;
  const ViewerReplayProgress& progress_;
  const std::function<bool()>& cancelled_;
  const std::unique_lock<std::mutex> loading_;
  const VolumeStore::Hold hold_;
  const VolumeState before_;
  RecordedVolumes follower_;
  std::shared_ptr<ShownSamples> shown_;

  // State of the reading, ahead of the shown position.
  double read_ms_ = 0.0;
  std::uint64_t read_ticks_ = 0;
  std::optional<std::uint64_t> missed_ticks_;
  std::vector<RecordedEdit> edits_;  // the edits before the next scene
  std::deque<Event> events_;

  bool started_ = false;
  Start start_;
  bool position_is_end_ = false;
  std::optional<AffineMap> placed_;
  std::uint64_t lost_ticks_ = 0;
};

}  // namespace

void ReplayToViewers(Session& session, Pump& pump, RecordingReader& reader,
                     const ViewerReplayOptions& options, const ViewerReplayProgress& progress,
                     const std::function<bool()>& cancelled) {
  if (!(options.speed > 0.0 && options.speed <= kMaxReplaySpeed)) {
    throw Error(ErrorKind::kInvalidArgument, "the speed must be above 0 and at most 100");
  }
  ViewerReplay(session, pump, reader, options, progress, cancelled).Run();
}

}  // namespace palpate
