// Carries the servo's samples to the sinks.
//
// The pump thread drains the outbox about once a millisecond, shortly after the servo's tick, so
// that the servo never has to wake a thread. It adds SCP_V to every sample and hands it to every
// sink, in order. It also keeps the first tick of each scene revision, for callers that wait until
// their change is felt.
//
// Threads: Subscribe and WaitForScene on any ordinary thread. Sinks are called on the pump thread,
// without a lock, and must not block: those of live samples first, as recordings may lose nothing.
// Ownership: borrows the outbox and the inbox; holds sinks by weak_ptr.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "server/felt/scene.h"
#include "server/haptics/cell_cache.h"
#include "server/pump/tick_outbox.h"

namespace palpate {

class SampleSink {
 public:
  virtual ~SampleSink() = default;
  virtual void OnSample(const TickSample& sample) = 0;
  // Called before the sample of the keyframe's tick.
  virtual void OnKeyframe(const ServoKeyframe&) {}
};

// Replaces the live ticks for viewers.
class SampleReplacement {
 public:
  virtual ~SampleReplacement() = default;
  // Called on the pump thread, once per live sample; must not block.
  virtual TickSample Shown(const TickSample& live) = 0;
};

// The tick at which a scene was first used.
struct AppliedTick {
  std::uint64_t tick = 0;
  std::int64_t time_ns = 0;
};

class Pump {
 public:
  Pump(TickOutbox& outbox, SceneInbox& inbox) : outbox_(outbox), inbox_(inbox) {}
  ~Pump() { Stop(); }

  void Start();
  void Stop() noexcept;

  static constexpr std::size_t kRememberedRevisions = 4096;

  enum class Feed : std::uint8_t { kLive, kShown };
  // kShown: for sinks that only show the ticks. They get the replacement while there is one.
  // Keyframes are always live.
  void Subscribe(std::weak_ptr<SampleSink> sink, Feed feed = Feed::kLive);

  // Null: no replacement. After the return, the previous replacement is not called any more.
  void Replace(std::shared_ptr<SampleReplacement> replacement);

  // True if the servo has ticked before and its last tick is older than this.
  bool ServoStands(std::chrono::milliseconds for_longer_than) const;

  // Returns the first tick with this revision or a newer one. Returns none if the servo does not
  // use the revision in time. Samples tell the tick. If the samples are late, the servo's board
  // tells the same tick. Call it within seconds after the revision was published: the first ticks
  // of only the newest kRememberedRevisions are known.
  std::optional<AppliedTick> WaitForScene(std::uint64_t scene_revision,
                                          std::chrono::milliseconds timeout);

 private:
  struct Subscriber {
    std::weak_ptr<SampleSink> sink;
    Feed feed;
  };

  void Run();
  void DeliverKeyframes(std::uint64_t up_to_tick);
  void Deliver(TickSample& sample);
  void TakeNewcomers();
  TickSample ShownFor(const TickSample& sample);
  void AddScpVOf(TickSample& sample);
  void NoteRevision(const TickSample& sample);
  void NoteUse(const SceneUse& use);
  void NoteUsesOfServo();

  TickOutbox& outbox_;
  SceneInbox& inbox_;
  std::atomic<bool> stop_{false};
  std::thread thread_;

  std::mutex newcomers_mutex_;
  std::vector<Subscriber> newcomers_;
  std::vector<Subscriber> sinks_;  // the pump thread's: those of live samples come first
  std::mutex replacement_mutex_;
  std::shared_ptr<SampleReplacement> replacement_;
  std::optional<ServoKeyframe> keyframe_;        // the pump thread's: the next to deliver
  std::optional<std::uint64_t> noted_revision_;  // the pump thread's: of the last sample
  std::shared_ptr<const Scene> scene_;           // the pump thread's: of the last sample
  std::unique_ptr<CellCache> cells_ = std::make_unique<CellCache>();  // the pump thread's

  std::mutex revisions_mutex_;  // guards first_uses_; held to read the board's scene_uses
  std::condition_variable revision_seen_;
  std::deque<SceneUse> first_uses_;  // ascending
};

}  // namespace palpate
