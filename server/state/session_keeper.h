// Saves the session to disk while the daemon runs, so that the next daemon can restore the
// session after SIGKILL, a crash or a loss of power. The file holds the volume's source, the
// isovalue and the settings. The file does not hold edited voxels: a second file beside it holds
// the number of edits. The RegistrationStore saves the places of volumes.
//
// If the configuration has changed since the save, the changed entries take their configured
// values. A left-over session is restored at most kMostAttempts times, unless a daemon runs with
// it for kLasting: the session may be the cause of the crash. A clean end deletes the file.
//
// Threads: main, and a thread of its own that polls `felt`; NoteEdits on any.
// Errors: none. A failure to save is logged.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "common/files/descriptor.h"
#include "server/state/session_file.h"

namespace palpate {

class SessionKeeper {
 public:
  static constexpr std::chrono::milliseconds kLook{50};
  static constexpr std::chrono::milliseconds kAfterFailure{500};
  static constexpr int kMostAttempts = 2;
  static constexpr std::chrono::seconds kLasting{60};

  using Felt = std::function<FeltSession()>;

  // `folder`: the daemon's state folder; if empty, nothing is saved. `socket`: this daemon's
  // socket, which names the file; other daemons of the same user have files beside it.
  // `configured`: the request that the daemon loads if there is no session to restore.
  // `felt`: returns the present session; called after a volume is loaded.
  SessionKeeper(const std::filesystem::path& folder, const std::filesystem::path& socket,
                LoadRequest configured, const RenderSettings& configured_settings, Felt felt);
  // Keeps the file: an end without End() counts as a crash.
  ~SessionKeeper() { Join(); }
  SessionKeeper(const SessionKeeper&) = delete;
  SessionKeeper& operator=(const SessionKeeper&) = delete;

  // Returns the previous daemon's session if that daemon crashed and the same volume is
  // configured; otherwise nothing. The isovalue is in the session's load request. A session
  // without a source cannot be loaded again.
  std::optional<FeltSession> TakeLeft();

  // Edits that the previous daemon lost when it crashed, once TakeLeft was called.
  std::uint64_t lost_edits() const { return lost_edits_; }

  // The daemon ends cleanly before it has restored the session. Does not count this attempt, so
  // that the next daemon can restore the session.
  void GiveBack() noexcept;

  // Starts to save. Call it once a volume is loaded.
  void Start();
  // The number of edits that are not saved. Does not wait for the disk.
  void NoteEdits(std::uint64_t unsaved_edits) noexcept;
  // A clean end: stops saving and deletes the file.
  void End() noexcept;

 private:
  std::string WhyNot(const SessionFile& file) const;
  void Run();
  // Returns false if it failed.
  bool Save(const FeltSession& felt);
  void OpenEdits();
  void Join() noexcept;

  const std::filesystem::path path_;  // empty: nothing is saved
  const std::filesystem::path edits_path_;
  const LoadRequest configured_;
  const RenderSettings configured_settings_;
  std::optional<SavedSession> taken_;
  int attempts_ = 0;  // to restore this session; 0 after kLasting
  const Felt felt_;
  std::string last_failure_;
  Descriptor edits_file_;  // -1: it cannot be written
  std::atomic<std::uint64_t> edits_ = 0;
  std::uint64_t lost_edits_ = 0;

  std::mutex mutex_;  // guards stop_
  std::condition_variable wake_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace palpate
