// Records the pump's samples without ever blocking the pump.
//
//   pump -> OnSample -> ring, 8 s -> writer thread -> RecordingWriter -> disk
//
// If the disk is slower than the ticks, the ring fills, samples are dropped, and the recording
// declares the gap. Scenes wait together with their volumes until the writer has taken the changed
// bricks. If the waiting volumes keep more than kMaxWaitingVoxelBytes, the recorder releases the
// oldest volumes, and their scenes declare that voxels are missing. One object makes one recording.
//
// Threads: OnSample and OnKeyframe on one thread (the pump's); the rest on any.
// Real-time: OnSample and OnKeyframe are wait-free and do not allocate. Nothing else is for
// real-time code.
// Ownership: owns the output and the writer thread. The pump may hold the recorder by weak_ptr
// for any time. Call Stop before the last owner releases the recorder: the last owner may be the
// pump, and the destructor waits for the disk.
// Errors: an error on the writer thread ends the recording. The data written so far stays, and
// the report holds the error. The recorder then drops everything that waits and takes no more.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "server/pump/pump.h"
#include "server/realtime/spsc_ring.h"
#include "server/realtime/tick_timer.h"
#include "server/recording/recording_writer.h"
#include "server/recording/voxel_log.h"

namespace palpate {

struct RecorderReport {
  RecordingCounts counts{};
  std::optional<Error> error{};  // recording ended early
  std::string left_out{};        // why some ticks cannot be computed again; empty: all can
};

class Recorder final : public SampleSink {
 public:
  static constexpr std::size_t kQueueTicks = 8192;
  // The most scenes, and the most markers, that wait for their tick.
  static constexpr std::size_t kMaxWaiting = 4096;
  static constexpr std::uint64_t kMaxWaitingVoxelBytes = std::uint64_t{256} << 20;

  // Writes the header and starts the writer thread. Throws the output's Error.
  // failed: called by the writer thread, once, if the recording ends early.
  // left_out: called by the writer thread, at most once for each volume, with the reason why some
  // ticks cannot be computed again.
  // now_ns: the clock of the recording; tests bring their own.
  Recorder(std::unique_ptr<RecordingOutput> output, const std::string& program,
           std::function<void(const Error&)> failed = {},
           std::function<void(const std::string&)> left_out = {},
           std::function<std::int64_t()> now_ns = MonotonicNowNs);
  ~Recorder() override;

  void OnSample(const TickSample& sample) override;
  void OnKeyframe(const ServoKeyframe& keyframe) override;

  // Call it before the pump delivers samples of this scene: for the present scene before
  // subscribing, for every later scene before it is published. The scene is written with the first
  // tick of its scene_revision; `scene.tick` is ignored. A scene that no tick used is left out.
  // `volume`: the scene's volume; the recorder also writes the voxels that the recording lacks. If
  // null, no voxels are written. `changed_bytes`: the memory that the previous volume keeps and
  // that this volume does not share.
  void NoteScene(const RecordedScene& scene, std::shared_ptr<const VolumeSnapshot> volume = {},
                 std::uint64_t changed_bytes = 0);

  // Sets a marker; returns its time, by which it is placed among the ticks (RecordedEvent). Throws
  // Error: kInvalidArgument if the text is empty or longer than kMaxMarkerBytes; kUnavailable if
  // too many markers wait or the recording has ended.
  std::int64_t Mark(const std::string& text);

  // The state so far. Neither count includes ticks that still wait.
  RecorderReport report() const;

  // Writes all delivered samples and the end; waits for the disk. A second call returns the
  // same report.
  RecorderReport Stop();

 private:
  struct WaitingScene {
    RecordedScene scene;
    std::shared_ptr<const VolumeSnapshot> volume;
    std::uint64_t changed_bytes;
  };

  void Run();
  void Drain();
  void Take(const TickSample& sample, std::int64_t ended_ns);
  std::vector<RecordedEvent> TakeMarkers(std::uint64_t tick, std::int64_t before_ns);
  std::optional<WaitingScene> TakeScene(const TickSample& sample);
  std::optional<RecordedKeyframe> TakeKeyframe(const TickSample& sample);
  void WriteScene(WaitingScene& waiting);
  void LetOldVolumesGo();
  void SayWhatIsLeftOut(const RecordedScene& scene);
  void WriteChunk();
  void WriteRest();
  void Publish();
  void Fail(const Error& error);

  SpscRing<TickSample, kQueueTicks> ring_;
  SpscRing<ServoKeyframe, kQueueTicks / kKeyframeTicks> keyframes_;
  // One past the last tick delivered, kept or dropped.
  std::atomic<std::uint64_t> delivered_end_{0};
  std::atomic<bool> stopped_{false};

  const std::function<void(const Error&)> failed_;
  const std::function<void(const std::string&)> left_out_;
  const std::function<std::int64_t()> now_ns_;

  // Used only by the writer thread.
  RecordingWriter writer_;
  std::optional<TickSample> newest_;  // waits for the next tick, which ends it
  std::int64_t chunk_since_ns_ = 0;
  std::optional<std::uint64_t> scene_revision_;
  VoxelLog voxels_;
  std::uint64_t left_out_of_ = 0;  // loaded_revision of the volume last reported as left out
  std::optional<ServoKeyframe> keyframe_;  // the next keyframe to write
  std::uint64_t keyframe_due_ = 0;         // no keyframe is written before this tick
  std::uint64_t next_tick_ = 0;            // the tick expected next; another tick means a gap

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable stop_;
  bool stopping_ = false;
  std::deque<WaitingScene> scenes_;
  std::size_t let_go_ = 0;  // the first let_go_ scenes have released their volumes
  std::uint64_t waiting_bytes_ = 0;
  std::deque<RecordedEvent> markers_;  // in the order of their times
  RecorderReport report_;

  std::mutex join_mutex_;
  std::thread thread_;
};

}  // namespace palpate
