// Saves the session to disk while the daemon runs, so that the next daemon can restore the
// session, whether this one ends in order or by SIGKILL, a crash or a loss of power. The file holds
// the volume's source, the isovalue and the settings. The file does not hold edited voxels: a
// second file beside it holds the number of edits. The RegistrationStore saves the places of
// volumes.
//
// If the configuration has changed since the save, the changed entries take their configured
// values. A session that a crash has left is restored at most kMostAttempts times, unless a daemon
// runs with it for kLasting: the session may be the cause of the crash.
//
// Threads: main, and a thread of its own that polls `felt`; NoteEdits and Await on any.
// Errors: none. A failure to save is logged, and Await returns it.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "common/files/descriptor.h"
#include "server/kept/saver.h"
#include "server/kept/session_file.h"

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
  // An end without End() counts as a crash.
  ~SessionKeeper() { saver_.reset(); }
  SessionKeeper(const SessionKeeper&) = delete;
  SessionKeeper& operator=(const SessionKeeper&) = delete;

  // Returns the previous daemon's session if the same volume is configured; otherwise nothing. The
  // isovalue is in the session's load request. A session without a source cannot be loaded again.
  // `fresh`: nothing, and the session is forgotten.
  std::optional<FeltSession> TakeLeft(bool fresh = false);

  // Known once TakeLeft was called: edits that the previous daemon lost at its end, and whether it
  // ended in order.
  std::uint64_t lost_edits() const { return lost_edits_; }
  bool ended_cleanly() const { return ended_cleanly_; }
  // Why its session does not come back although the same volume is configured; empty: it does.
  const std::string& why_not() const { return why_not_; }

  // The daemon ends cleanly before it has restored the session. Does not count this attempt, so
  // that the next daemon can restore the session.
  void GiveBack() noexcept;

  // Starts to save. Call it once a volume is loaded.
  void Start();
  // The number of edits that are not saved. Does not wait for the disk.
  void NoteEdits(std::uint64_t unsaved_edits) noexcept;
  // Waits until what is felt now is on the disk. Returns why it is not; empty: it is, or nothing is
  // saved at all.
  std::string Await();
  // Why the last save failed; empty: it did not.
  std::string failure() const;
  // A clean end. Call it when nothing changes any more.
  void End() noexcept;

 private:
  std::string WhyNot(const SessionFile& file) const;
  void Forget(const std::string& why);
  // As Saver::Save.
  std::string SaveChanges(bool at_once);
  std::string Write(const SavedSession& session);
  void OpenEdits();

  const std::filesystem::path path_;  // empty: nothing is saved
  const std::filesystem::path edits_path_;
  const LoadRequest configured_;
  const RenderSettings configured_settings_;
  std::optional<SavedSession> taken_;
  int attempts_ = 0;  // to restore this session; 0 after kLasting
  const Felt felt_;
  std::string last_failure_;
  Descriptor edits_file_;                   // the saver's thread's, and main's
  std::atomic<int> edits_descriptor_ = -1;  // edits_file_'s; -1: it cannot be written
  std::atomic<std::uint64_t> edits_ = 0;
  std::uint64_t lost_edits_ = 0;
  bool ended_cleanly_ = false;
  std::string why_not_;

  // The saver's thread's, until it has ended.
  std::optional<std::uint64_t> saved_revision_;  // of the settings; none: not saved
  std::uint64_t edits_on_disk_ = 0;
  std::chrono::steady_clock::time_point retry_at_{}, lasts_at_{};
  std::atomic<bool> is_started_ = false;
  std::optional<Saver> saver_;  // last, so that its thread ends first
};

}  // namespace palpate
