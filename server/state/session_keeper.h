// Keeps what is felt on the disk while the daemon runs, so that it comes back after an
// end out of order (SIGKILL, a crash, a loss of power): the volume's source, isovalue and
// settings. Not voxels that were edited; where volumes lie is the RegistrationStore's.
//
// What the configuration changed meanwhile is as configured. What is left is gone on with
// at most kMostAttempts times where no daemon with it lasted for kLasting: it may be what
// they die of. An end in order leaves nothing.
//
// Threads: main, and one of its own, which asks twice a second what is felt.
// Errors: none; what cannot be kept is said in the log.
#pragma once

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "server/state/session_file.h"

namespace palpate {

class SessionKeeper {
 public:
  static constexpr std::chrono::milliseconds kInterval{500};
  static constexpr int kMostAttempts = 2;
  static constexpr std::chrono::seconds kLasting{60};

  using Felt = std::function<FeltSession()>;

  // `folder` of the daemon's state; empty: nothing is kept. `socket`: of this daemon,
  // for others of this user may keep theirs beside it. `configured`: what is felt where
  // nothing was left. `felt`: what is felt now, once a volume is loaded.
  SessionKeeper(const std::filesystem::path& folder, const std::filesystem::path& socket,
                LoadRequest configured, const RenderSettings& configured_settings, Felt felt);
  // Leaves the file: what ends without End is no end in order.
  ~SessionKeeper() { Join(); }
  SessionKeeper(const SessionKeeper&) = delete;
  SessionKeeper& operator=(const SessionKeeper&) = delete;

  // Of the daemon before, which did not end in order, with the isovalue in its request; of
  // one for which another volume was configured, nothing. Without a source: it cannot be
  // loaded again.
  std::optional<FeltSession> TakeLeft();

  // An end in order before what was left could be felt: it is left again, for the next one.
  void GiveBack() noexcept;

  // Once a volume is loaded.
  void Start();
  // An end in order.
  void End() noexcept;

 private:
  std::string WhyNot(const SessionFile& file) const;
  void Run();
  void Save(const FeltSession& felt);
  void Join() noexcept;

  const std::filesystem::path path_;  // empty: none
  const LoadRequest configured_;
  const RenderSettings configured_settings_;
  std::optional<SavedSession> taken_;
  int attempts_ = 0;  // with this one; 0 once it lasted
  const Felt felt_;
  std::string last_failure_;

  std::mutex mutex_;  // guards stop_
  std::condition_variable wake_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace palpate
