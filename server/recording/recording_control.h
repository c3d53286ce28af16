// The recording or the replay of a session: one at a time.
//
// Threads: any ordinary thread; OnScene is the session's. Not for real-time code.
// Ownership: borrows session and pump; outlives whatever publishes scenes.
// Errors: Error.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "server/recording/recorder.h"
#include "server/recording/viewer_replay.h"
#include "server/session/session.h"

namespace palpate {

struct RecordingStatus {
  bool running = false;
  std::string path{};  // of the last one; empty: none yet
  RecordingCounts counts{};
  std::optional<Error> error{};  // it ended early
  std::string left_out{};        // why some ticks cannot be computed again; empty: all can
};

// Which files may be written and read: each takes what a client named, and gives the path, or the
// open file, or throws Error.
struct RecordingPaths {
  std::function<std::filesystem::path(const std::string&)> save;
  std::function<std::unique_ptr<std::istream>(const std::string&)> open;
};

class RecordingControl final : public SceneListener {
 public:
  using Report = std::function<void(const std::string& line, bool is_error)>;

  // Listens to the session: before its first Load. `program`: name and version;
  // `safety`, `device`: the servo's. `report`: told by any thread, a line, when a recording ends
  // early (an error), or cannot hold what is felt (none).
  RecordingControl(Session& session, Pump& pump, RecordingPaths paths, std::string program,
                   const SafetyLimits& safety, const PassivityDevice& device, Report report = {});
  ~RecordingControl() override { End(); }

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;

  // kConflict: the file is there, another recording or a replay runs; what the path
  // check and CreateRecordingFile throw.
  RecordingStatus Start(const std::string& path, bool overwrite);
  // Waits for the disk. kConflict where none was started since the last Stop.
  RecordingStatus Stop();
  RecordingStatus status() const;
  // The time of the marker, ns of CLOCK_MONOTONIC. kConflict where nothing is recorded.
  std::int64_t Mark(const std::string& text);

  // As ReplayToViewers. kConflict while a recording or a replay runs; kNotFound.
  void Replay(const std::string& path, double speed, const ViewerReplayProgress& progress,
              const std::function<bool()>& cancelled);

  // Closes the recording, if one runs.
  void End() noexcept;

 private:
  void CheckIdle() const;
  std::shared_ptr<Recorder> recorder() const;

  Session& session_;
  Pump& pump_;
  const RecordingPaths paths_;
  const std::string program_;
  const SafetyLimits safety_;
  const PassivityDevice device_;
  const Report report_;

  // Start, Stop and the beginning of replays, one after the other.
  std::mutex commands_;
  std::atomic<bool> replaying_{false};

  mutable std::mutex mutex_;  // guards what follows, briefly
  std::optional<RecordedScene> scene_;
  std::shared_ptr<const VolumeSnapshot> volume_;  // the scene's
  std::shared_ptr<Recorder> recorder_;
  RecordingStatus last_;  // of the one before, and the path of this one

  const Listening listening_{session_, *this};
};

}  // namespace palpate
