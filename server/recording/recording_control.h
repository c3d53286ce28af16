// Starts and stops the recording or the replay of a session; only one runs at a time. Says what a
// replay can be asked for.
//
// Threads: any ordinary thread; OnScene is the session's. Not for real-time code.
// Ownership: borrows session and pump; must outlive every publisher of scenes.
// Errors: Error.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/contract/recording.h"
#include "server/recording/recorder.h"
#include "server/recording/recording_list.h"
#include "server/recording/recording_reader.h"
#include "server/recording/viewer_replay.h"
#include "server/session/session.h"

namespace palpate {

// How long a recording is, and where its markers are. A marker's tick counts the recorded ticks
// before it, as palpate.v1.RecordedMarker says. Ticks that were not recorded do not count.
struct RecordingOutline {
  std::uint64_t ticks = 0;
  std::vector<RecordedMarker> markers{};  // in order
};

// A small file may hold gigabytes of markers: later ones are left out.
inline constexpr std::size_t kMostOutlineBytes = std::size_t{1} << 20;

// Reads to the end, or to the first damage. Throws Error: kCancelled.
RecordingOutline ReadOutline(RecordingReader& reader, const std::function<bool()>& cancelled);

struct RecordingStatus {
  bool running = false;
  std::string path{};  // of the last recording; empty: none yet
  RecordingCounts counts{};
  std::optional<Error> error{};  // why the recording ended early
  std::string left_out{};        // why some ticks cannot be computed again; empty: all can
  std::optional<RunningReplay> replay{};
};

// Decide which files may be written and read. Each function takes the name that a client sent.
// `save` returns the path to write, `open` returns the open file; both throw Error to refuse.
// `folders`: to which clients save, the one for new recordings first.
struct RecordingPaths {
  std::function<std::filesystem::path(const std::string&)> save;
  std::function<std::unique_ptr<std::istream>(const std::string&)> open;
  std::vector<std::filesystem::path> folders{};
};

// What a client learns of a replay: at the start all of it, then where it is.
struct ReplayReport {
  ViewerReplayState state{};
  std::uint64_t total_ticks = 0;
  std::vector<RecordedMarker> markers{};  // with the first report only
};
using ReplayReports = std::function<void(ReplayReport)>;

class RecordingControl final : public SceneListener {
 public:
  using Report = std::function<void(const std::string& line, bool is_error)>;

  // Listens to the session; construct it before the session's first Load. `program`: name and
  // version. `safety`, `device`: the servo's. `report`: called by any thread with one line if a
  // recording ends early (is_error), or if it cannot hold all voxels (not is_error).
  RecordingControl(Session& session, Pump& pump, RecordingPaths paths, std::string program,
                   const SafetyLimits& safety, const PassivityDevice& device, Report report = {});
  ~RecordingControl() override { End(); }

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;

  // Throws Error: kConflict if the file exists or another recording or a replay runs; also every
  // error of paths.save and CreateRecordingFile.
  RecordingStatus Start(const std::string& path, bool overwrite);
  // Waits for the disk. Throws kConflict if no recording was started since the last Stop.
  RecordingStatus Stop();
  RecordingStatus status() const;
  // Returns the marker's time, in ns of CLOCK_MONOTONIC. Throws kConflict if no recording runs.
  std::int64_t Mark(const std::string& text);

  // See ReplayToViewers. Also throws kConflict while a recording or a replay runs, and kNotFound.
  void Replay(const std::string& path, const ViewerReplayOptions& options,
              const ReplayReports& report, const std::function<bool()>& cancelled);

  std::vector<ListedRecording> Recordings() const {
    return FindRecordings(paths_.folders, paths_.open);
  }
  // Where new recordings belong; empty: clients may save nowhere, or the name is not UTF-8.
  std::filesystem::path folder() const { return FolderForNew(paths_.folders); }

  // Closes the recording, if one runs.
  void End() noexcept;

 private:
  // The outline of the last replay's file, and what tells this file from others.
  struct KnownOutline {
    std::string path{};
    std::uintmax_t size_bytes = 0;
    std::filesystem::file_time_type modified{};
    RecordingOutline outline{};
  };

  RecordingOutline OutlineOf(const std::string& path, const std::function<bool()>& cancelled);
  void SetReplay(std::optional<RunningReplay> replay);
  void CheckIdle() const;
  std::shared_ptr<Recorder> recorder() const;

  Session& session_;
  Pump& pump_;
  const RecordingPaths paths_;
  const std::string program_;
  const SafetyLimits safety_;
  const PassivityDevice device_;
  const Report report_;

  // Held by Start, Stop and the beginning of Replay, so that they take turns.
  std::mutex commands_;
  std::atomic<bool> replaying_{false};
  KnownOutline known_;  // of the one replay that runs

  mutable std::mutex mutex_;  // guards the members below; held only briefly
  std::optional<RecordedScene> scene_;
  std::shared_ptr<const VolumeSnapshot> volume_;  // the scene's
  std::shared_ptr<Recorder> recorder_;
  RecordingStatus last_;  // of the previous recording, but its path is the present recording's
  std::optional<RunningReplay> replay_;

  const Listening listening_{session_, *this};
};

}  // namespace palpate
