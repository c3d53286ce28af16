#include "server/recording/recorder.h"

#include <pthread.h>

#include <chrono>
#include <exception>
#include <utility>

#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

// The ring is looked at this often: a fraction of what it holds.
constexpr std::chrono::milliseconds kPollPeriod{20};
// Samples are written at the latest so long after they came.
constexpr std::int64_t kMaxAgeNs = 2'000'000'000;

}  // namespace

Recorder::Recorder(std::unique_ptr<RecordingOutput> output, const std::string& program)
    : writer_(std::move(output), program) {
  samples_.reserve(kSamplesPerChunk);
  report_.counts = writer_.counts();
  thread_ = std::thread([this] { Run(); });
}

Recorder::~Recorder() { Stop(); }

void Recorder::OnSample(const TickSample& sample) {
  if (stopped_.load(std::memory_order_relaxed)) return;
  ring_.TryPush(sample);
  delivered_end_.store(sample.tick + 1, std::memory_order_release);
}

void Recorder::NoteScene(const RecordedScene& scene) {
  const std::lock_guard lock(mutex_);
  scenes_.push_back(scene);
  // So many wait only for a disk that has stopped. Samples without their scene
  // show by their revision.
  if (scenes_.size() > kMaxWaiting) scenes_.pop_front();
}

void Recorder::Mark(const std::string& text) {
  if (text.size() > kMaxMarkerBytes) {
    throw Error(ErrorKind::kInvalidArgument, "a marker has at most 4096 bytes of text");
  }
  const std::lock_guard lock(mutex_);
  if (report_.error) throw *report_.error;
  if (stopping_) throw Error(ErrorKind::kUnavailable, "the recording has ended");
  if (markers_.size() == kMaxWaiting) {
    throw Error(ErrorKind::kUnavailable, "too many markers wait for the disk: try again later");
  }
  markers_.push_back({delivered_end_.load(std::memory_order_acquire),
                      {.time_ns = MonotonicNowNs(), .text = text}});
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
      // The last round is for what came before it.
      if (last) stopped_.store(true, std::memory_order_relaxed);
      Drain();
      if (last) break;
    }
    WriteRest();
    Publish(std::nullopt);
  } catch (const Error& error) {
    Publish(error);
  } catch (const std::exception& error) {
    Publish(Error(ErrorKind::kInternal, error.what()));
  }
  stopped_.store(true, std::memory_order_relaxed);
}

void Recorder::Drain() {
  // At most a ring of them: where the disk is the slower one, the ring is never
  // empty, and Stop is to be heard all the same.
  TickSample sample;
  for (std::size_t n = 0; n < kQueueTicks && ring_.TryPop(sample); ++n) Take(sample);
  if (!samples_.empty() && MonotonicNowNs() - samples_since_ns_ > kMaxAgeNs) WriteSamples();
}

void Recorder::Take(const TickSample& sample) {
  std::optional<RecordedScene> scene;
  if (sample.scene_revision != scene_revision_) scene = TakeScene(sample);
  scene_revision_ = sample.scene_revision;
  const std::vector<RecordedMarker> markers = TakeMarkers(sample.tick);
  if (scene || !markers.empty()) WriteSamples();
  if (scene) writer_.Append(*scene);
  for (const RecordedMarker& marker : markers) writer_.Append(marker);

  if (samples_.empty()) samples_since_ns_ = MonotonicNowNs();
  samples_.push_back(sample);
  if (samples_.size() == kSamplesPerChunk) WriteSamples();
}

// Scenes before the sample's were never used.
std::optional<RecordedScene> Recorder::TakeScene(const TickSample& sample) {
  const std::lock_guard lock(mutex_);
  while (!scenes_.empty() && scenes_.front().scene_revision <= sample.scene_revision) {
    RecordedScene scene = std::move(scenes_.front());
    scenes_.pop_front();
    if (scene.scene_revision == sample.scene_revision) {
      scene.tick = sample.tick;
      return scene;
    }
  }
  return std::nullopt;
}

std::vector<RecordedMarker> Recorder::TakeMarkers(std::uint64_t tick) {
  std::vector<RecordedMarker> markers;
  const std::lock_guard lock(mutex_);
  while (!markers_.empty() && markers_.front().from_tick <= tick) {
    markers_.front().marker.tick = tick;
    markers.push_back(std::move(markers_.front().marker));
    markers_.pop_front();
  }
  return markers;
}

void Recorder::WriteSamples() {
  writer_.AppendSamples(samples_);
  samples_.clear();
  Publish(std::nullopt);
}

void Recorder::WriteRest() {
  const std::uint64_t end = delivered_end_.load(std::memory_order_acquire);
  WriteSamples();
  // The last ones may have been dropped.
  if (writer_.next_tick() && *writer_.next_tick() < end) writer_.SkipTo(end);
  for (const RecordedMarker& marker : TakeMarkers(writer_.next_tick().value_or(end))) {
    writer_.Append(marker);
  }
  writer_.AppendEnd();
}

void Recorder::Publish(const std::optional<Error>& error) {
  const std::lock_guard lock(mutex_);
  report_ = {writer_.counts(), error};
}

}  // namespace palpate
