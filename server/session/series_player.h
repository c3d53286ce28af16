// Plays a time series under the stylus: all frames are in memory, and each comes at
// one tick.
//
// Frame n is shown from position n until position n + 1; where the series is
// interpolated, neighbours are blended in between. In a loop the last frame lasts as
// long as the others before the first one comes again. Played from the end to which
// it runs, the series begins again at the other one.
//
// Edits of a frame are kept in it when the player moves on; edits made between two frames are
// lost then. Where the memory budget has no room for a blend, the frame before it is shown. A load
// of another volume ends the series.
//
// Threads: any ordinary thread but the servo's; a thread of its own publishes. At most
// kMostPerSecond volumes per second. Ownership: borrows the session. Errors: Error;
// nothing changes then.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <thread>

#include "server/session/series.h"
#include "server/session/session.h"

namespace palpate {

struct SeriesState {
  std::uint32_t frames = 0;
  double position_frames = 0.0;  // of what is shown; whole unless interpolated
  bool playing = false;
  double rate_hz = 10.0;  // frames per second, negative backwards
  bool loop = false;
  bool interpolate = false;
  std::uint64_t memory_bytes = 0;
  std::uint64_t volume_revision = 0;  // under the stylus now
};

// What is absent stays.
struct SeriesControl {
  std::optional<bool> playing{};
  std::optional<double> position_frames{};  // 0 to frames - 1
  std::optional<double> rate_hz{};          // -1000 to 1000, not 0
  std::optional<bool> loop{};
  std::optional<bool> interpolate{};
};

class SeriesPlayer {
 public:
  static constexpr int kMostPerSecond = 60;
  static constexpr double kGreatestRateHz = 1000.0;

  explicit SeriesPlayer(Session& session);
  ~SeriesPlayer() { Stop(); }

  // Shows no frame any more: before the session's listeners end.
  void Stop() noexcept;
  SeriesPlayer(const SeriesPlayer&) = delete;
  SeriesPlayer& operator=(const SeriesPlayer&) = delete;

  // Loads all frames, publishes the first and pauses there. `request` as for
  // LoadSeries, with isovalue, scale and title. Errors: as LoadSeries and
  // Session::Load.
  VolumeState Load(std::span<const std::filesystem::path> files, const LoadRequest& request,
                   const LoadProgress& progress, const LoadCancelled& cancelled);

  // kConflict where no series is loaded.
  SeriesState state() const;
  // Answers at once; what is shown follows. kConflict, kInvalidArgument.
  SeriesState Control(const SeriesControl& control);

 private:
  using Clock = std::chrono::steady_clock;
  struct Series;

  void Run();
  // Waits until there may be something to show. Null: nothing.
  std::shared_ptr<Series> WaitForWork(std::unique_lock<std::mutex>& lock);
  void Advance(Clock::time_point now);
  double ShownPosition() const;
  SeriesState StateLocked(const VolumeState& volume) const;
  // False when the series has ended.
  bool Show(Series& series, double position);
  std::optional<BrickDirectory> TryBlend(Series& series, std::size_t frame, double share,
                                         MemoryClaim& claim);
  // In a transaction. What others changed since it was shown goes into its frame. False as Show.
  bool KeepEdits(Series& series, const VolumeSnapshot& present);

  Session& session_;

  mutable std::mutex mutex_;  // guards what follows; never held while publishing
  std::condition_variable wake_;
  bool stop_ = false;
  bool changed_ = false;
  std::shared_ptr<Series> series_;  // null: none
  double position_ = 0.0;           // 0 to below frames: the last one lasts, too
  bool playing_ = false;
  double rate_hz_ = 10.0;
  bool loop_ = false;
  bool interpolate_ = false;
  Clock::time_point advanced_at_;  // position_ was right then

  std::thread thread_;
};

}  // namespace palpate
