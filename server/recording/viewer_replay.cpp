#include "server/recording/viewer_replay.h"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "common/error/error.h"
#include "server/felt/felt_surface.h"
#include "server/recording/recorded_scenes.h"
#include "server/recording/volume_hash.h"
#include "server/recording/voxel_log.h"
#include "server/session/ball_maker.h"

namespace palpate {

TickSample ShownSamples::Shown(const TickSample& live) {
  const std::uint64_t live_ms = live.tick + live.missed_ticks;
  const std::lock_guard lock(mutex_);
  const std::uint64_t since_ms = live_ms_ ? live_ms - *live_ms_ : 0;
  live_ms_ = live_ms;
  // The position never passes the last sample: if the disk is too slow, the replay waits.
  position_ms_ = std::min(position_ms_ + speed_ * static_cast<double>(since_ms), end_ms_);
  while (!waiting_.empty() && waiting_.front().position_ms <= position_ms_ &&
         waiting_.front().sample.settings_revision <= scene_) {
    current_ = waiting_.front().sample;
    waiting_.pop_front();
    ++passed_;
  }
  if (!current_) return live;
  TickSample shown = *current_;
  shown.tick = live.tick;
  shown.time_ns = live.time_ns;
  shown.scene_revision = live.scene_revision;
  shown.settings_revision = first_revision_ + scene_;
  shown.volume_revision = volume_revision_;
  shown.missed_ticks = live.missed_ticks;
  shown.capped_ticks = live.capped_ticks;
  shown.faulty_ticks = live.faulty_ticks;
  shown.force_state = live.force_state;
  shown.force_reason = live.force_reason;
  shown.force_limit_n = live.force_limit_n;
  shown.torque_limit_n_mm = live.torque_limit_n_mm;
  shown.replayed = true;
  return shown;
}

void ShownSamples::SetScene(std::uint64_t number, std::uint64_t first_revision,
                            std::uint64_t volume_revision) {
  const std::lock_guard lock(mutex_);
  scene_ = number;
  first_revision_ = first_revision;
  volume_revision_ = volume_revision;
}

void ShownSamples::Add(const TickSample& sample, double position_ms) {
  const std::lock_guard lock(mutex_);
  waiting_.push_back({position_ms, sample});
  end_ms_ = position_ms;
}

double ShownSamples::position_ms() const {
  const std::lock_guard lock(mutex_);
  return position_ms_;
}

std::size_t ShownSamples::waiting() const {
  const std::lock_guard lock(mutex_);
  return waiting_.size();
}

std::uint64_t ShownSamples::passed() const {
  const std::lock_guard lock(mutex_);
  return passed_;
}

namespace {

constexpr std::chrono::milliseconds kReplayPollPeriod{2};
constexpr std::chrono::milliseconds kReportPeriod{100};
constexpr std::chrono::seconds kGiveBackPatience{2};
constexpr std::chrono::milliseconds kServoPatience{500};
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
  std::uint64_t number = 0;  // of the scene
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

// What was felt of the tip, as Session::ball tells it.
BallState BallOf(const RecordedScene& scene) {
  const bool is_ball = scene.tool.ball.empty() && !scene.fields.empty();
  const std::vector<Ball> wanted = FieldsOf(scene.settings, scene.X_DI);
  const bool is_there =
      std::ranges::equal(wanted, scene.fields, HaveSameField) && scene.tool == scene.settings.tool;
  const std::string problem = RefusalOfTip(scene.settings, scene.X_DI);
  return {.felt_radius_mm = is_ball ? RadiusMm(scene.fields.front(), scene.X_DI) : 0.0,
          .is_awaited = !is_there && problem.empty(),
          .problem = problem};
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
        loaded_(session.volume().volume),
        as_loaded_(options.as_loaded ? options.as_loaded() : nullptr),
        follower_([this](const RecordedScene& scene) { return VolumeFor(scene); }),
        samples_(std::make_shared<ShownSamples>(options.speed)) {}

  void Run() {
    CheckStart();
    try {
      session_.SetForcesOff(true);
      Begin();
      pump_.Replace(samples_);
      Play();
    } catch (...) {
      GiveBack();
      throw;
    }
    GiveBack();
  }

 private:
  // What is shown first.
  struct Start {
    std::shared_ptr<const VolumeSnapshot> volume{};
    std::optional<RecordedScene> scene{};
    std::uint64_t number = 0;  // of the scene
  };

  std::shared_ptr<const VolumeSnapshot> VolumeFor(const RecordedScene& scene) const {
    const bool has_other = as_loaded_ &&
                           as_loaded_->loaded_revision() == loaded_->loaded_revision() &&
                           as_loaded_->size() == loaded_->size();
    return has_other && HashVolume(*loaded_) != scene.volume_hash ? as_loaded_ : loaded_;
  }

  // Changes nothing in the session, so it may throw without a GiveBack.
  void CheckStart() {
    while (!IsSceneWaiting() && read_ms_ < kLatestSceneMs && events_.size() < kMaxEventsAhead &&
           ReadOne()) {
    }
    if (!IsSceneWaiting()) {
      throw Error(ErrorKind::kInvalidArgument,
                  "the recording does not begin with a scene: it was cut, or is damaged");
    }
    FollowNewest();
    SkipToFirstTick();
    if (!start_.volume) throw *follower_.error();
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

  // The newest scene is where the replay starts. If its voxels are missing, the last ones stay.
  void FollowNewest() {
    Event& event = events_.back();
    for (RecordedEdit& edit : event.edits) follower_.Take(std::move(edit));
    event.edits.clear();
    auto volume = follower_.Follow(*event.scene);
    const bool is_same_volume =
        start_.scene && start_.scene->loaded_revision == event.scene->loaded_revision;
    if (!volume && is_same_volume) volume = start_.volume;
    start_ = {std::move(volume), std::move(event.scene), event.number};
    event.scene.reset();
  }

  bool IsSceneWaiting() const { return !events_.empty() && events_.back().scene; }

  void Play() {
    auto report_at = std::chrono::steady_clock::now();
    for (bool more = true; more || samples_->waiting() > 0 || !events_.empty();) {
      while (more && IsRoomAhead()) more = ReadOne();
      if (!more && samples_->waiting() == 0) position_is_end_ = true;
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

  bool IsRoomAhead() const { return !IsFull() && read_ms_ - samples_->position_ms() < ahead_ms_; }

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
    // The voxels count against the budget by themselves (brick_memory.h).
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
      events_.back().number = ++scenes_;
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

  void Place(TickSample sample) {
    if (read_ticks_++ < first_tick_) return;
    sample.settings_revision = std::max<std::uint64_t>(scenes_, 1);  // its scene's number
    const std::uint64_t missed = missed_ticks_ ? sample.missed_ticks - *missed_ticks_ : 0;
    // The first one is shown at once, however slow the replay is.
    if (missed_ticks_) read_ms_ += static_cast<double>(1 + std::min(missed, kLongestPauseMs));
    missed_ticks_ = sample.missed_ticks;
    samples_->Add(sample, read_ms_);
  }

  void ApplyDue() {
    // The samples behind the events are read only when these have made room.
    const bool all = position_is_end_ || (samples_->waiting() == 0 && IsFull());
    while (!events_.empty() && (all || events_.front().position_ms <= samples_->position_ms())) {
      Event event = std::move(events_.front());
      events_.pop_front();
      lost_ticks_ += event.lost_ticks;
      if (!event.marker.empty()) Report(event.marker);
      if (event.scene) Apply(event);
    }
  }

  void Apply(Event& event) {
    const RecordedScene& scene = *event.scene;
    for (RecordedEdit& edit : event.edits) follower_.Take(std::move(edit));
    const auto volume = follower_.Follow(scene);
    if (!volume && scene.loaded_revision != shown_loaded_revision_) {
      throw Error(ErrorKind::kConflict,
                  fmt::format("the recording goes on with another volume, {}: load it, and replay "
                              "from {:.1f} s on",
                              scene.volume_source,
                              1e-3 * static_cast<double>(first_tick_ + samples_->passed())));
    }
    Show(scene, volume ? volume->bricks() : volume_->bricks(), event.number);
  }

  // In a transaction: from it on, viewers get nothing of the session's voxels.
  void Begin() {
    session_.store().Edit([&](const std::shared_ptr<const VolumeSnapshot>& present) {
      // By an undo that was on its way when forces went off.
      if (present->loaded_revision() != loaded_->loaded_revision()) {
        throw Error(ErrorKind::kConflict, "another volume came meanwhile: replay once more");
      }
      // A replay that could not end is still shown.
      const auto before = session_.shown().replayed();
      volume_ = before ? before->volume : present;
      begun_revision_ = present->revision();
      first_revision_ = session_.settings().settings_revision;
      Show(*start_.scene, start_.volume->bricks(), start_.number);
      return VolumeChange();
    });
  }

  void Show(const RecordedScene& recorded, const BrickDirectory& bricks, std::uint64_t number) {
    auto scene = std::make_shared<ShownScene>();
    VolumeMetadata metadata = volume_->metadata();
    scene->place = PlaceOf(recorded, metadata);
    const std::vector<BrickChange> changes = volume_->bricks().ChangesTo(bricks);
    if (!changes.empty() || metadata.series_position_frames != recorded.series_position_frames) {
      metadata.series_position_frames = recorded.series_position_frames;
      const std::uint64_t revision = volume_->revision() + 1;
      volume_ = std::make_shared<const VolumeSnapshot>(std::move(metadata),
                                                       volume_->bricks().With(changes, revision),
                                                       revision, volume_->loaded_revision());
    }
    scene->settings = {.isovalue = recorded.isovalue,
                       .normalized_isovalue = volume_->Normalize(recorded.isovalue),
                       .haptics = recorded.settings};
    scene->settings_revision = first_revision_ + number;
    scene->ball = BallOf(recorded);
    scene->volume = volume_;
    scene->X_DI = recorded.X_DI;
    shown_loaded_revision_ = recorded.loaded_revision;
    session_.shown().Replace(std::move(scene));
    samples_->SetScene(number, first_revision_, volume_->revision());
  }

  // Forces stay off, and the last scene stays, if viewers cannot get the session's volume again.
  void GiveBack() {
    // A replay before this one may not have ended.
    if (const auto shown = session_.shown().replayed()) volume_ = shown->volume;
    const auto end = std::chrono::steady_clock::now() + kGiveBackPatience;
    while (volume_) {
      try {
        session_.RaiseSettingsRevision(first_revision_ + scenes_);
        session_.store().Edit([&](const auto& present) { return BackTo(present); });
        break;
      } catch (const std::exception& error) {
        if (std::chrono::steady_clock::now() > end) throw CannotEnd(error);
        std::this_thread::sleep_for(kReportPeriod);
      }
    }
    // Before the servo has used it, samples are older than what viewers have seen.
    pump_.WaitForScene(session_.volume().scene_revision, kServoPatience);
    pump_.Replace(nullptr);
    session_.SetForcesOff(false);
  }

  static Error CannotEnd(const std::exception& error) {
    return {ErrorKind::kInternal, std::string("the replay cannot end, and forces stay off: ") +
                                      error.what() + "; restart palpated"};
  }

  // The session's voxels with a revision that viewers have not seen. All bricks that differ from
  // those of the replay, or have changed in the session meanwhile, have changed in it.
  VolumeChange BackTo(const std::shared_ptr<const VolumeSnapshot>& present) {
    VolumeChange change;
    const bool is_same_lattice = present->loaded_revision() == volume_->loaded_revision();
    if (present != volume_ && is_same_lattice) {
      const BrickDirectory& shown = volume_->bricks();
      const BrickDirectory& live = present->bricks();
      std::vector<BrickChange> changes = shown.ChangesTo(live);
      std::set<std::uint64_t> numbers;
      for (const BrickChange& one : changes) numbers.insert(live.NumberOf(one.brick));
      for (const std::uint64_t number : live.ChangedSince(begun_revision_)) {
        const Vec3i brick = live.BrickOf(number);
        if (numbers.insert(number).second) changes.push_back({brick, live.At(brick)});
      }
      const std::uint64_t revision = std::max(present->revision(), volume_->revision()) + 1;
      change.renumbered = std::make_shared<const VolumeSnapshot>(
          present->metadata(), shown.With(changes, revision), revision, present->loaded_revision());
    }
    change.after_publication = [this] { session_.shown().Replace(nullptr); };
    return change;
  }

  void Report(const std::string& marker) {
    progress_(
        {.ticks = first_tick_ + samples_->passed(), .lost_ticks = lost_ticks_, .marker = marker});
  }

  Session& session_;
  Pump& pump_;
  RecordingReader& reader_;
  const std::uint64_t first_tick_;
  const double ahead_ms_;
  const ViewerReplayProgress& progress_;
  const std::function<bool()>& cancelled_;
  const std::unique_lock<std::mutex> loading_;
  const std::shared_ptr<const VolumeSnapshot> loaded_;  // the present voxels
  const std::shared_ptr<const VolumeSnapshot>
      as_loaded_;  // before their edits; null: there are none
  RecordedVolumes follower_;
  std::shared_ptr<ShownSamples> samples_;
  std::shared_ptr<const VolumeSnapshot> volume_;  // that viewers are shown; null: not yet

  // State of the reading, ahead of the shown position.
  double read_ms_ = 0.0;
  std::uint64_t read_ticks_ = 0;
  std::optional<std::uint64_t> missed_ticks_;
  std::vector<RecordedEdit> edits_;  // the edits before the next scene
  std::uint64_t scenes_ = 0;
  std::deque<Event> events_;

  std::uint64_t first_revision_ = 0;         // of the settings, before the first scene
  std::uint64_t begun_revision_ = 0;         // of the session's volume at the beginning
  std::uint64_t shown_loaded_revision_ = 0;  // of the scene that is shown
  Start start_;
  bool position_is_end_ = false;
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
