// Carries the servo's samples to those who want them.
//
// The pump thread drains the outbox about once a millisecond, shortly after the
// servo's tick, so that the servo never has to wake anybody. It hands every
// sample to every sink, in order, and keeps the first tick of each scene
// revision for those who wait for their change to be felt.
//
// Threads: Subscribe and WaitForScene on any ordinary thread;
// sinks are called on the pump thread and must not block.
// Ownership: borrows the outbox; sinks are held by weak_ptr.
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

#include "server/samples/tick_outbox.h"

namespace palpate {

class SampleSink {
 public:
  virtual ~SampleSink() = default;
  virtual void OnSample(const TickSample& sample) = 0;
  // Before the sample of its tick.
  virtual void OnKeyframe(const ServoKeyframe&) {}
};

// What viewers are shown instead of the live ticks.
class SampleReplacement {
 public:
  virtual ~SampleReplacement() = default;
  // On the pump thread, once per live sample; must not block.
  virtual TickSample Shown(const TickSample& live) = 0;
};

// The tick at which a scene was first used.
struct AppliedTick {
  std::uint64_t tick = 0;
  std::int64_t time_ns = 0;
};

class Pump {
 public:
  explicit Pump(TickOutbox& outbox) : outbox_(outbox) {}
  ~Pump() { Stop(); }

  void Start();
  void Stop() noexcept;

  enum class Feed : std::uint8_t { kLive, kShown };
  // kShown: for those who only show the ticks, and get a replacement while there is
  // one. Keyframes are always live.
  void Subscribe(std::weak_ptr<SampleSink> sink, Feed feed = Feed::kLive);

  // Null: none. When it returns, the one before is not called any more.
  void Replace(std::shared_ptr<SampleReplacement> replacement);

  // Whether the servo made no tick for longer than that, having made some.
  bool ServoStands(std::chrono::milliseconds for_longer_than) const;

  // First tick with this revision or a newer one; none when the servo does not use it
  // in time. Samples name the tick; where they are late, the servo itself does, and then
  // it is the first one of its newest scene.
  std::optional<AppliedTick> WaitForScene(std::uint64_t scene_revision,
                                          std::chrono::milliseconds timeout);

 private:
  struct FirstUse {
    std::uint64_t scene_revision;
    AppliedTick applied;
  };

  struct Subscriber {
    std::weak_ptr<SampleSink> sink;
    Feed feed;
  };

  void Run();
  void DeliverKeyframes(std::uint64_t up_to_tick);
  void Deliver(const TickSample& sample);
  void NoteRevision(const TickSample& sample);

  TickOutbox& outbox_;
  std::atomic<bool> stop_{false};
  std::thread thread_;

  std::mutex sinks_mutex_;
  std::vector<Subscriber> sinks_;
  std::shared_ptr<SampleReplacement> replacement_;
  std::optional<ServoKeyframe> keyframe_;  // the pump thread's: next to deliver

  std::mutex revisions_mutex_;
  std::condition_variable revision_seen_;
  std::deque<FirstUse> first_uses_;  // ascending
};

}  // namespace palpate
