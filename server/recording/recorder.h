// Records what the pump delivers, without ever holding it up.
//
//   pump -> OnSample -> ring, 8 s -> writer thread -> RecordingWriter -> disk
//
// Where the disk is slower than the ticks, the ring fills, samples are dropped,
// and the recording declares the gap. One object is one recording.
//
// Threads: OnSample on one thread (the pump's); the rest on any.
// Real-time: OnSample is wait-free and does not allocate. Nothing else is for
// real-time code.
// Ownership: owns the output and the writer thread. The pump may hold it by
// weak_ptr for as long as it likes; Stop before the last owner lets go, which may
// be the pump, since the destructor waits for the disk.
// Errors: what the writer thread meets ends the recording there, keeps what was
// written, and is in the report.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "server/realtime/spsc_ring.h"
#include "server/recording/recording_writer.h"
#include "server/session/pump.h"

namespace palpate {

struct RecorderReport {
  RecordingCounts counts{};
  std::optional<Error> error{};  // recording ended early
};

class Recorder final : public SampleSink {
 public:
  static constexpr std::size_t kQueueTicks = 8192;
  static constexpr std::size_t kMaxMarkerBytes = 4096;
  // Scenes and markers that wait for their tick.
  static constexpr std::size_t kMaxWaiting = 4096;

  // Writes the header and starts the writer thread. Throws the output's Error.
  Recorder(std::unique_ptr<RecordingOutput> output, const std::string& program);
  ~Recorder() override;

  void OnSample(const TickSample& sample) override;

  // Before the pump delivers samples of this scene: the one in use before
  // subscribing, every other before it is published. It is written with the first
  // tick of its scene_revision; `scene.tick` is ignored. A scene that no tick
  // used is left out.
  void NoteScene(const RecordedScene& scene);

  // Marks the next tick. Throws Error: kInvalidArgument above kMaxMarkerBytes;
  // kUnavailable where too many wait or the recording has ended.
  void Mark(const std::string& text);

  // What is written so far; ticks that wait are in neither count.
  RecorderReport report() const;

  // Writes what was delivered, and the end; waits for the disk. Again: the same
  // report.
  RecorderReport Stop();

 private:
  struct WaitingMarker {
    std::uint64_t from_tick;
    RecordedMarker marker;
  };

  void Run();
  void Drain();
  void Take(const TickSample& sample);
  std::vector<RecordedMarker> TakeMarkers(std::uint64_t tick);
  std::optional<RecordedScene> TakeScene(const TickSample& sample);
  void WriteSamples();
  void WriteRest();
  void Publish(const std::optional<Error>& error);

  SpscRing<TickSample, kQueueTicks> ring_;
  // One past the last tick delivered, kept or dropped.
  std::atomic<std::uint64_t> delivered_end_{0};
  std::atomic<bool> stopped_{false};

  // The writer thread's own.
  RecordingWriter writer_;
  std::vector<TickSample> samples_;
  std::int64_t samples_since_ns_ = 0;
  std::optional<std::uint64_t> scene_revision_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable stop_;
  bool stopping_ = false;
  std::deque<RecordedScene> scenes_;
  std::deque<WaitingMarker> markers_;
  RecorderReport report_;

  std::mutex join_mutex_;
  std::thread thread_;
};

}  // namespace palpate
