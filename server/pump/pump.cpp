#include "server/pump/pump.h"

#include <pthread.h>

#include <algorithm>
#include <utility>

#include "server/pump/pose_of.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

constexpr std::int64_t kPeriodNs = 1'000'000;
// Added to the start of the servo's tick. The tick's work takes a few microseconds.
constexpr std::int64_t kDelayNs = 100'000;
// Samples come within a few milliseconds of their tick, unless the machine is overloaded.
constexpr std::chrono::milliseconds kSamplePatience{500};

void SleepUntil(std::int64_t time_ns) {
  const timespec time{time_ns / 1'000'000'000, time_ns % 1'000'000'000};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, nullptr);
}

}  // namespace

void Pump::Start() {
  stop_.store(false);
  inbox_.StartFollowing();
  thread_ = std::thread([this] { Run(); });
}

void Pump::Stop() noexcept {
  stop_.store(true);
  if (thread_.joinable()) thread_.join();
  inbox_.StopFollowing();
  scene_.reset();
}

void Pump::Subscribe(std::weak_ptr<SampleSink> sink, Feed feed) {
  const std::lock_guard lock(newcomers_mutex_);
  newcomers_.push_back({std::move(sink), feed});
}

void Pump::Replace(std::shared_ptr<SampleReplacement> replacement) {
  const std::lock_guard lock(replacement_mutex_);
  replacement_.swap(replacement);
}

bool Pump::ServoStands(std::chrono::milliseconds for_longer_than) const {
  const std::optional<LastTick> newest = outbox_.last.newest();
  const std::int64_t limit_ns = std::chrono::nanoseconds(for_longer_than).count();
  return newest && MonotonicNowNs() - newest->time_ns > limit_ns;
}

std::optional<AppliedTick> Pump::WaitForScene(std::uint64_t scene_revision,
                                              std::chrono::milliseconds timeout) {
  const auto end = std::chrono::steady_clock::now() + timeout;
  std::unique_lock lock(revisions_mutex_);
  const auto seen = [&] {
    return !first_uses_.empty() && first_uses_.back().scene_revision >= scene_revision;
  };
  while (!revision_seen_.wait_for(lock, std::min(timeout, kSamplePatience), seen)) {
    // Read the clock before the tick: a thread that lost its core then checks once more.
    const bool is_last = std::chrono::steady_clock::now() >= end;
    NoteUsesOfServo();
    if (seen()) break;
    if (is_last) return std::nullopt;
  }
  const auto first = std::lower_bound(
      first_uses_.begin(), first_uses_.end(), scene_revision,
      [](const SceneUse& use, std::uint64_t revision) { return use.scene_revision < revision; });
  return AppliedTick{first->tick, first->time_ns};
}

void Pump::Run() {
  pthread_setname_np(pthread_self(), "palpate-pump");
  std::int64_t next_ns = MonotonicNowNs();
  while (!stop_.load(std::memory_order_relaxed)) {
    SleepUntil(next_ns);
    next_ns = std::max(next_ns, MonotonicNowNs() - kPeriodNs) + kPeriodNs;
    const std::uint64_t reached = inbox_.reached();
    bool is_idle = true;
    TickSample sample;
    while (outbox_.TryPop(sample)) {
      is_idle = false;
      Deliver(sample);
      // Keeps in step with the servo.
      next_ns = std::max(sample.time_ns + kPeriodNs + kDelayNs, MonotonicNowNs());
    }
    if (is_idle) {
      scene_.reset();  // the next sample may have another one
      inbox_.FollowedUpTo(reached);
    }
  }
}

// A keyframe of a later tick waits for the sample of its tick.
void Pump::DeliverKeyframes(std::uint64_t up_to_tick) {
  for (;;) {
    if (!keyframe_) {
      ServoKeyframe next;
      if (!outbox_.keyframes.TryPop(next)) return;
      keyframe_ = next;
    }
    if (keyframe_->tick > up_to_tick) return;
    for (const Subscriber& subscriber : sinks_) {
      if (const auto sink = subscriber.sink.lock()) sink->OnKeyframe(*keyframe_);
    }
    keyframe_.reset();
  }
}

void Pump::AddScpVOf(TickSample& sample) {
  if (!scene_ || scene_->scene_revision != sample.scene_revision) {
    scene_.reset();  // first: once Follow has moved on, the pump might be its last holder
    scene_ = inbox_.Follow(
        [&](const Scene& scene) { return scene.scene_revision == sample.scene_revision; });
  }
  if (scene_) AddScpV(*scene_, *cells_, sample);
}

void Pump::Deliver(TickSample& sample) {
  NoteRevision(sample);
  AddScpVOf(sample);
  TakeNewcomers();
  DeliverKeyframes(sample.tick);
  const TickSample shown = ShownFor(sample);
  std::erase_if(sinks_, [&](const Subscriber& subscriber) {
    const std::shared_ptr<SampleSink> sink = subscriber.sink.lock();
    if (sink) sink->OnSample(subscriber.feed == Feed::kShown ? shown : sample);
    return !sink;
  });
}

void Pump::TakeNewcomers() {
  const std::lock_guard lock(newcomers_mutex_);
  if (newcomers_.empty()) return;
  sinks_.insert(sinks_.end(), newcomers_.begin(), newcomers_.end());
  newcomers_.clear();
  std::stable_partition(sinks_.begin(), sinks_.end(),
                        [](const Subscriber& one) { return one.feed == Feed::kLive; });
}

TickSample Pump::ShownFor(const TickSample& sample) {
  const std::lock_guard lock(replacement_mutex_);
  return replacement_ ? replacement_->Shown(sample) : sample;
}

void Pump::NoteRevision(const TickSample& sample) {
  if (std::exchange(noted_revision_, sample.scene_revision) == sample.scene_revision) return;
  {
    const std::lock_guard lock(revisions_mutex_);
    // First, because a sample may be lost.
    NoteUsesOfServo();
    NoteUse({sample.scene_revision, sample.tick, sample.time_ns});
  }
  revision_seen_.notify_all();
}

void Pump::NoteUsesOfServo() {
  SceneUse use;
  while (outbox_.last.scene_uses.TryPop(use)) NoteUse(use);
}

// The board and the samples tell the same; the first one counts.
void Pump::NoteUse(const SceneUse& use) {
  if (!first_uses_.empty() && first_uses_.back().scene_revision >= use.scene_revision) return;
  first_uses_.push_back(use);
  if (first_uses_.size() > kRememberedRevisions) first_uses_.pop_front();
}

}  // namespace palpate
