#include "client/view/palpated/replayer.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>
#include <utility>

namespace palpate::view {
namespace {

// So slow that a pause of hours shows one tick.
constexpr double kStill = 1e-8;
// The replay before this one may take so long to end.
constexpr std::chrono::seconds kMostHandover{5};
constexpr std::chrono::milliseconds kHandoverPeriod{20};

}  // namespace

// One call of Replay. Shared with its command.
struct Replayer::Playing {
  explicit Playing(const ReplayPosition& from) : position(from) {}

  std::atomic<bool> is_cancelled{false};
  mutable std::mutex mutex;  // guards the member below
  ReplayPosition position;

  ReplayPosition Position() const {
    const std::lock_guard lock(mutex);
    return position;
  }
  // False ends the replay.
  bool Take(const client::ReplayState& state) {
    const std::lock_guard lock(mutex);
    if (!position.is_paused) position.tick = state.ticks;
    position.total_ticks = state.total_ticks;
    if (!position.markers && !state.markers.empty()) {
      position.markers = std::make_shared<const std::vector<client::RecordedMarker>>(state.markers);
    }
    return !is_cancelled;
  }
  void Run(client::Client& client) {
    const ReplayPosition from = Position();
    const client::ReplayOptions options = {.speed = from.is_paused ? kStill : from.speed,
                                           .first_tick = from.tick};
    const auto begin = std::chrono::steady_clock::now();
    while (!is_cancelled) {
      try {
        client.Replay(from.path, options,
                      [this](const client::ReplayState& state) { return Take(state); });
        return;
      } catch (const Error& error) {
        if (error.kind() == ErrorKind::kCancelled) return;
        // The daemon may still be ending the replay before this one.
        const bool waits = error.kind() == ErrorKind::kConflict && from.total_ticks > 0 &&
                           std::chrono::steady_clock::now() - begin < kMostHandover;
        if (!waits) throw;
        std::this_thread::sleep_for(kHandoverPeriod);
      }
    }
  }
};

struct Replayer::Listed {
  std::mutex mutex;  // guards the member below
  std::shared_ptr<const client::RecordingList> list;
};

Replayer::Replayer(client::Client& client, Commands& others)
    : others_(others), listed_(std::make_shared<Listed>()), replays_(client) {}

Replayer::~Replayer() { End(); }

void Replayer::Begin(const ReplayPosition& from) {
  End();
  playing_ = std::make_shared<Playing>(from);
  replays_.Do("replay", [playing = playing_](client::Client& client) { playing->Run(client); });
}

void Replayer::Play(const std::string& path) { Begin({.path = path}); }

void Replayer::Restart(const std::function<void(ReplayPosition&)>& change) {
  const std::optional<ReplayPosition> now = position();
  if (!now || now->total_ticks == 0) return;
  ReplayPosition from = *now;
  change(from);
  const bool is_same =
      from.tick == now->tick && from.is_paused == now->is_paused && from.speed == now->speed;
  if (is_same) return;
  from.tick = std::min(from.tick, from.total_ticks - 1);
  Begin(from);
}

void Replayer::Seek(std::uint64_t tick) {
  Restart([&](ReplayPosition& from) { from.tick = tick; });
}

void Replayer::SetPaused(bool paused) {
  Restart([&](ReplayPosition& from) { from.is_paused = paused; });
}

void Replayer::SetSpeed(double speed) {
  Restart([&](ReplayPosition& from) { from.speed = speed; });
}

void Replayer::End() {
  if (playing_) playing_->is_cancelled = true;
  playing_.reset();
}

std::optional<ReplayPosition> Replayer::position() const {
  if (!playing_ || !replays_.busy()) return std::nullopt;
  return playing_->Position();
}

void Replayer::Refresh() {
  others_.Do("list recordings", [listed = listed_](client::Client& client) {
    auto list = std::make_shared<const client::RecordingList>(client.ListRecordings());
    const std::lock_guard lock(listed->mutex);
    listed->list = std::move(list);
  });
}

std::shared_ptr<const client::RecordingList> Replayer::list() const {
  const std::lock_guard lock(listed_->mutex);
  return listed_->list;
}

}  // namespace palpate::view
