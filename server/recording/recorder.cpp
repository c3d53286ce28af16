#include "server/recording/recorder.h"

#include <pthread.h>

#include <chrono>
#include <exception>
#include <limits>
#include <utility>

namespace palpate {
namespace {

// The writer thread drains the ring this often. The ring holds many times more.
constexpr std::chrono::milliseconds kPollPeriod{20};
// Samples wait at most this long before they are written.
constexpr std::int64_t kMaxAgeNs = 1'000'000'000;
// About a second.
constexpr std::uint64_t kKeyframePeriodTicks = kSamplesPerChunk - kKeyframeTicks;
constexpr std::int64_t kNeverNs = std::numeric_limits<std::int64_t>::max();

bool IsTooLarge(const RecordedScene& scene, const VolumeSnapshot* volume) {
  return volume && !scene.reloadable && !VoxelLog::HasRoomForAll(*volume);
}

std::string WhyLeftOut(const RecordedScene& scene) {
  if (scene.voxels_missing) {
    return "a change of " + scene.volume_source +
           " is missing (more than 64 MiB at once, or the disk was too slow): ticks after it "
           "cannot be computed again";
  }
  return scene.volume_source +
         " is too large to be recorded (more than 64 MiB) and cannot be loaded again: keep the "
         "uploaded file to compute the ticks again; ticks of series, raw voxels and single frames "
         "cannot be computed again";
}

}  // namespace

Recorder::Recorder(std::unique_ptr<RecordingOutput> output, const std::string& program,
                   std::function<void(const Error&)> failed,
                   std::function<void(const std::string&)> left_out,
                   std::function<std::int64_t()> now_ns)
    : failed_(std::move(failed)),
      left_out_(std::move(left_out)),
      now_ns_(std::move(now_ns)),
      writer_(std::move(output), program) {
  report_.counts = writer_.counts();
  thread_ = std::thread([this] { Run(); });
}

Recorder::~Recorder() { Stop(); }

void Recorder::OnSample(const TickSample& sample) {
  if (stopped_.load(std::memory_order_relaxed)) return;
  ring_.TryPush(sample);
  delivered_end_.store(sample.tick + 1, std::memory_order_release);
}

void Recorder::OnKeyframe(const ServoKeyframe& keyframe) {
  if (!stopped_.load(std::memory_order_relaxed)) keyframes_.TryPush(keyframe);
}

void Recorder::NoteScene(const RecordedScene& scene, std::shared_ptr<const VolumeSnapshot> volume,
                         std::uint64_t changed_bytes) {
  const std::lock_guard lock(mutex_);
  if (report_.error) return;
  // Checked before the first sample, so that the client that starts a recording learns it at once.
  if (IsTooLarge(scene, volume.get())) report_.left_out = WhyLeftOut(scene);
  scenes_.push_back({scene, std::move(volume), changed_bytes});
  waiting_bytes_ += changed_bytes;
  // So many scenes wait only if the disk has stopped. Samples without their scene can be recognised
  // by their revision.
  if (scenes_.size() > kMaxWaiting) {
    waiting_bytes_ -= scenes_.front().changed_bytes;
    scenes_.pop_front();
    if (let_go_ > 0) --let_go_;
  }
  LetOldVolumesGo();
}

// Keeps the newest volume, which is in use anyway.
void Recorder::LetOldVolumesGo() {
  while (waiting_bytes_ > kMaxWaitingVoxelBytes && let_go_ + 1 < scenes_.size()) {
    WaitingScene& oldest = scenes_[let_go_++];
    waiting_bytes_ -= oldest.changed_bytes;
    oldest.changed_bytes = 0;
    oldest.volume.reset();
  }
}

std::int64_t Recorder::Mark(const std::string& text) {
  if (text.empty() || text.size() > kMaxMarkerBytes) {
    throw Error(ErrorKind::kInvalidArgument, "a marker has 1 to 4096 bytes of text");
  }
  const std::lock_guard lock(mutex_);
  if (report_.error) throw *report_.error;
  if (stopping_) throw Error(ErrorKind::kUnavailable, "the recording has ended");
  if (markers_.size() == kMaxWaiting) {
    throw Error(ErrorKind::kUnavailable, "too many markers wait for the disk: try again later");
  }
  const std::int64_t now_ns = now_ns_();
  markers_.push_back({.time_ns = now_ns, .marker = text});
  return now_ns;
}

RecorderReport Recorder::report() const {
  const std::lock_guard lock(mutex_);
  return report_;
}

RecorderReport Recorder::Stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  stop_.notify_all();
  const std::lock_guard lock(join_mutex_);
  if (thread_.joinable()) thread_.join();
  return report();
}

void Recorder::Run() {
  pthread_setname_np(pthread_self(), "palpate-record");
  try {
    for (;;) {
      bool last;
      {
        std::unique_lock lock(mutex_);
        last = stop_.wait_for(lock, kPollPeriod, [&] { return stopping_; });
      }
      // The last round takes only samples delivered before it.
      if (last) stopped_.store(true, std::memory_order_relaxed);
      Drain();
      if (last) break;
    }
    WriteRest();
    Publish();
  } catch (const Error& error) {
    Fail(error);
  } catch (const std::exception& error) {
    Fail(Error(ErrorKind::kInternal, error.what()));
  }
  stopped_.store(true, std::memory_order_relaxed);
}

void Recorder::Drain() {
  // Takes at most as many samples as the ring holds. If the disk is slower than the ticks, the ring
  // is never empty, and Stop must still be noticed.
  TickSample sample;
  for (std::size_t n = 0; n < kQueueTicks && ring_.TryPop(sample); ++n) {
    if (newest_) Take(*newest_, sample.time_ns);
    newest_ = sample;
  }
  if (writer_.waiting_ticks() > 0 && now_ns_() - chunk_since_ns_ > kMaxAgeNs) WriteChunk();
}

// Markers are set before the next tick's sample is delivered, or have a later time than that tick.
// So all markers of a tick are known when the next one comes.
void Recorder::Take(const TickSample& sample, std::int64_t ended_ns) {
  std::optional<WaitingScene> scene;
  if (sample.scene_revision != scene_revision_) scene = TakeScene(sample);
  scene_revision_ = sample.scene_revision;
  if (sample.tick != next_tick_) keyframe_due_ = sample.tick;
  next_tick_ = sample.tick + 1;
  if (scene) WriteScene(*scene);
  if (const auto keyframe = TakeKeyframe(sample)) writer_.Append(*keyframe);
  for (const RecordedEvent& marker : TakeMarkers(sample.tick, ended_ns)) writer_.Append(marker);
  if (writer_.waiting_ticks() == 0) chunk_since_ns_ = now_ns_();
  writer_.Append(sample);
  if (writer_.waiting_ticks() == kSamplesPerChunk) WriteChunk();
}

// No tick used the scenes before the sample's scene.
std::optional<Recorder::WaitingScene> Recorder::TakeScene(const TickSample& sample) {
  // Destroyed after the lock is released, because freeing a volume takes time.
  std::vector<WaitingScene> unused;
  const std::lock_guard lock(mutex_);
  while (!scenes_.empty() && scenes_.front().scene.scene_revision <= sample.scene_revision) {
    WaitingScene waiting = std::move(scenes_.front());
    scenes_.pop_front();
    if (let_go_ > 0) --let_go_;
    waiting_bytes_ -= waiting.changed_bytes;
    if (waiting.scene.scene_revision == sample.scene_revision) {
      waiting.scene.tick = sample.tick;
      return waiting;
    }
    unused.push_back(std::move(waiting));
  }
  return std::nullopt;
}

void Recorder::WriteScene(WaitingScene& waiting) {
  const auto edit = voxels_.EditBefore(waiting.scene, waiting.volume.get());
  if (edit) writer_.Append(*edit);
  writer_.Append(waiting.scene);
  if (waiting.scene.voxels_missing || IsTooLarge(waiting.scene, waiting.volume.get())) {
    SayWhatIsLeftOut(waiting.scene);
  }
}

void Recorder::SayWhatIsLeftOut(const RecordedScene& scene) {
  if (left_out_of_ == scene.loaded_revision) return;
  left_out_of_ = scene.loaded_revision;
  const std::string why = WhyLeftOut(scene);
  {
    const std::lock_guard lock(mutex_);
    report_.left_out = why;
  }
  if (left_out_) left_out_(why);
}

std::optional<RecordedKeyframe> Recorder::TakeKeyframe(const TickSample& sample) {
  while (!keyframe_ || keyframe_->tick < sample.tick) {
    ServoKeyframe next;
    if (!keyframes_.TryPop(next)) return std::nullopt;
    keyframe_ = next;
  }
  if (keyframe_->tick != sample.tick || sample.tick < keyframe_due_) return std::nullopt;
  keyframe_due_ = sample.tick + kKeyframePeriodTicks;
  return RecordedKeyframe{.tick = sample.tick, .state = std::string(keyframe_->view())};
}

std::vector<RecordedEvent> Recorder::TakeMarkers(std::uint64_t tick, std::int64_t before_ns) {
  std::vector<RecordedEvent> markers;
  const std::lock_guard lock(mutex_);
  while (!markers_.empty() && markers_.front().time_ns < before_ns) {
    markers_.front().tick = tick;
    markers.push_back(std::move(markers_.front()));
    markers_.pop_front();
  }
  return markers;
}

void Recorder::WriteChunk() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  writer_.Append(
      RecordedClock{now_ns_(), std::chrono::duration_cast<std::chrono::nanoseconds>(now).count()});
  writer_.EndChunk();
  Publish();
}

void Recorder::WriteRest() {
  const std::uint64_t end = delivered_end_.load(std::memory_order_acquire);
  if (newest_) Take(*newest_, kNeverNs);
  // The last samples may have been dropped.
  if (writer_.next_tick() && *writer_.next_tick() < end) writer_.SkipTo(end);
  // Only if no tick was recorded.
  for (const RecordedEvent& marker : TakeMarkers(end, kNeverNs)) writer_.Append(marker);
  WriteChunk();
  writer_.AppendEnd();
}

void Recorder::Publish() {
  const std::lock_guard lock(mutex_);
  report_.counts = writer_.counts();
}

void Recorder::Fail(const Error& error) {
  stopped_.store(true, std::memory_order_relaxed);
  try {
    writer_.EndChunk();  // what waits, if it was not the disk
  } catch (const std::exception&) {
  }
  {
    // Destroyed after the lock is released, because freeing a volume takes time, and before failed_
    // is called.
    std::deque<WaitingScene> scenes;
    std::deque<RecordedEvent> markers;
    const std::lock_guard lock(mutex_);
    report_.counts = writer_.counts();
    report_.error = error;
    scenes.swap(scenes_);
    markers.swap(markers_);
    let_go_ = 0;
    waiting_bytes_ = 0;
  }
  if (failed_) failed_(error);
}

}  // namespace palpate
