// The daemon's recordings: their list, and the replay of one of them to all viewers.
//
// The daemon plays from a tick on, to the end. So a seek, another speed, a pause and the way on
// from it each end the daemon's replay and begin another one; in a pause it is so slow that it
// stands still. In between, the live state is back for a moment.
//
// Threads: that of the frames; calls have threads of their own (Commands). Errors: in problem().
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/sdk/recording.h"
#include "client/view/palpated/commands.h"

namespace palpate::view {

struct ReplayPosition {
  std::string path{};
  std::uint64_t tick = 0;
  std::uint64_t total_ticks = 0;                                         // 0: not known yet
  std::shared_ptr<const std::vector<client::RecordedMarker>> markers{};  // null: not known yet
  double speed = 1.0;
  bool is_paused = false;
};

class Replayer {
 public:
  // `others`: for short calls. Both must outlive the replayer. The destructor ends the replay.
  Replayer(client::Client& client, Commands& others);
  ~Replayer();

  // Replaces the present replay.
  void Play(const std::string& path);
  // The following do nothing without a replay.
  void Seek(std::uint64_t tick);
  void SetPaused(bool paused);
  // Multiple of real time, above 0, at most 100.
  void SetSpeed(double speed);
  // Live again.
  void End();
  // None: nothing is replayed from here.
  std::optional<ReplayPosition> position() const;
  // Why the last replay ended early; empty for a while after it began, and if it did not.
  std::string problem() const { return replays_.problem(); }

  // Asks for the list.
  void Refresh();
  // The newest one; null before the first answer.
  std::shared_ptr<const client::RecordingList> list() const;

 private:
  struct Playing;
  struct Listed;

  void Begin(const ReplayPosition& from);
  void Restart(const std::function<void(ReplayPosition&)>& change);

  Commands& others_;
  std::shared_ptr<Playing> playing_;
  std::shared_ptr<Listed> listed_;
  Commands replays_;  // its commands share what they use: any place will do
};

}  // namespace palpate::view
