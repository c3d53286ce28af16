// Plays a time series under the stylus. All frames are in memory. The stylus feels a new frame
// from one tick to the next.
//
// Frame n is shown from position n until position n + 1. If the series is interpolated,
// neighbouring frames are blended in between. In a loop, the last frame lasts as long as the
// others before the first frame comes again. If play starts at the end of the series (at the first
// frame for a negative rate) and the series does not loop, it begins again at the other end.
//
// When the player moves on, edits made while a whole frame was shown stay in that frame; edits
// made to a blend are lost. If the memory budget has no room for a blend, the player shows the
// frame before the blend. A load of another volume ends the series.
//
// Threads: any ordinary thread but the servo's; a thread of its own publishes. At most
// kMostPerSecond volumes per second. Ownership: borrows the session. Errors: Error; the state is
// unchanged then.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "common/contract/series.h"
#include "server/live_volume/volume_loader.h"
#include "server/session/session.h"
#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/brick_memory.h"

namespace palpate {

// Loads and blends the frames of a time series.
//
// Frame: I; all frames have one lattice. Values in data units; all frames have one range.
// Threads: LoadSeries on any ordinary thread, blocks until done; Blend is pure.
struct LoadedSeries {
  VolumeMetadata metadata;  // of the first frame; range and number of frames are of all frames
  std::vector<BrickDirectory> frames;  // frames share equal leaves
  std::uint64_t memory_bytes = 0;      // of all frames
};

// Loads one file with several frames, or several files with one frame each. Uses spacing_mm, raw,
// grid and component of `request`. Claims the memory of all frames before it reads the first frame;
// if only the file tells the number of frames, right after the first frame. The claim shrinks as
// frames are made. Throws Error: as VolumeLoader::Load; kInvalidArgument for fewer than two frames,
// for several frames in one of several files, for different sizes, and for level sets mixed with
// densities; kTooLarge. `work`: the calling thread's.
LoadedSeries LoadSeries(const VolumeLoader& loader, std::span<const std::filesystem::path> files,
                        const LoadRequest& request, const LoadProgress& progress,
                        const LoadCancelled& cancelled, std::vector<std::string>& warnings,
                        const BrickWork& work);

// Returns (1 - share) of `from` plus `share` of `to`. Bricks that both have stay shared.
// `bytes_known`: called with the memory for the other bricks before they are made; an exception
// from it ends the blend.
BrickDirectory Blend(const BrickDirectory& from, const BrickDirectory& to, double share,
                     const std::function<void(std::uint64_t bytes)>& bytes_known = {});

// What the stylus feels after a change.
struct SeriesControlled {
  SeriesState series;
  std::uint64_t scene_revision = 0;  // for Session::WaitForServo
};

class SeriesPlayer {
 public:
  static constexpr int kMostPerSecond = 60;
  static constexpr double kGreatestRateHz = 1000.0;

  using Clock = std::chrono::steady_clock;

  // now: the clock by which the series plays; tests pass their own.
  explicit SeriesPlayer(Session& session, std::function<Clock::time_point()> now = Clock::now);
  ~SeriesPlayer() { Stop(); }

  // Joins the thread; no frame is shown afterwards. Call it before the session's listeners end.
  void Stop() noexcept;
  SeriesPlayer(const SeriesPlayer&) = delete;
  SeriesPlayer& operator=(const SeriesPlayer&) = delete;

  // Loads all frames, publishes the first one and pauses there. `request`: see LoadSeries; the
  // isovalue, scale and title are used, too. `settings`: see Session::Load. Errors: those of
  // LoadSeries and Session::Load.
  VolumeState Load(std::span<const std::filesystem::path> files, const LoadRequest& request,
                   const LoadProgress& progress, const LoadCancelled& cancelled,
                   const SettingsUpdate& settings = {});

  // As viewers are shown it: during a replay, at the recorded position. Throws kConflict if no
  // series is loaded.
  SeriesState state() const;
  // Waits until the thread has published the frame, and returns this frame's position and revision.
  // If the frame is there already, the scene is the present one. If somebody else seeks meanwhile,
  // the frame may be theirs. Throws kConflict if no series is loaded or it ends meanwhile,
  // kInvalidArgument for a value out of range.
  SeriesControlled Control(const ControlSeriesRequest& control);

 private:
  struct Series;
  // What was shown for the commands up to this one.
  struct Taken {
    std::uint64_t command = 0;
    double position = 0.0;
    EditedRevisions revisions{};
  };

  void Run();
  // Waits until there may be a frame to show. Returns null if there is none.
  std::shared_ptr<Series> WaitForWork(std::unique_lock<std::mutex>& lock);
  void Take(const ControlSeriesRequest& control);
  void Advance(Clock::time_point now);
  double ShownPosition() const;
  SeriesState StateLocked(const VolumeState& volume) const;
  // Says once that frames are left out, if one took longer than it lasts.
  void SayIfSlow(Series& series, Clock::duration took, bool has_ball);
  // Returns none when the series has ended.
  std::optional<EditedRevisions> Show(Series& series, double position);
  std::optional<BrickDirectory> TryBlend(Series& series, std::size_t frame, double share,
                                         MemoryClaim& claim);
  // Call it in a transaction. Stores edits made since the frame was shown in that frame. Returns
  // false when the series has ended.
  bool KeepEdits(Series& series, const VolumeSnapshot& present);

  Session& session_;
  const std::function<Clock::time_point()> now_;

  mutable std::mutex mutex_;  // guards the members below; never held while publishing
  std::condition_variable wake_;
  bool stop_ = false;
  bool changed_ = false;
  bool sought_ = false;         // position_ is to be shown before it advances
  std::uint64_t commands_ = 0;  // calls of Control
  Taken taken_;
  std::condition_variable was_taken_;  // also when the series ends
  std::shared_ptr<Series> series_;     // null: none
  double position_ = 0.0;              // 0 to below `frames`: the last frame lasts, too
  bool playing_ = false;
  double rate_hz_ = 10.0;
  bool loop_ = false;
  bool interpolate_ = false;
  Clock::time_point advanced_at_;  // the time for which position_ was computed

  std::thread thread_;
};

}  // namespace palpate
