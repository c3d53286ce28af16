// The session: the volume and the settings that are felt, what changes them, and what is kept of
// them.
//
// Threads: main.
// Errors: Error.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "server/app/config.h"
#include "server/app/instrument.h"
#include "server/client_paths/path_policy.h"
#include "server/kept/registration_store.h"
#include "server/kept/session_keeper.h"
#include "server/recording/recording_control.h"
#include "server/session/edits/volume_editor.h"
#include "server/session/series/series_player.h"
#include "server/session/session.h"
#include "server/session/tools/tools.h"
#include "server/simulated_hand/hand_guide.h"

namespace palpate {

// The files and folders of this daemon, and those that clients may name.
struct DaemonPaths {
  explicit DaemonPaths(const LoadedConfig& loaded);

  // For the next start; empty: nothing is kept. Unless the configuration names it:
  // $STATE_DIRECTORY (systemd's; the first of several), $XDG_STATE_HOME/palpate or
  // ~/.local/state/palpate, whichever is an absolute path.
  std::filesystem::path state_folder;
  std::string socket;
  OwnFiles own_files;  // clients may neither load nor overwrite these
  PathPolicy clients;
};

// What the previous daemon has left, and what of it is lost.
struct SessionLeft {
  std::optional<FeltSession> felt{};
  std::string lost{};          // in words for clients; empty: nothing
  std::string bad_settings{};  // why `felt` cannot come back; empty: it can
};

class SessionParts {
 public:
  // Borrows all. The servo may run afterwards.
  SessionParts(const LoadedConfig& loaded, const DaemonPaths& paths, Instrument& instrument);
  // Stops the servo and the pump first: the parts here take their samples.
  ~SessionParts();

  // Takes what the previous daemon has left. Call it once the socket is claimed, because a running
  // daemon's session is its own, and before a client can set anything.
  void TakeLeft();
  // Call it after TakeLeft. Loads the first volume, with a running servo, and starts what needs
  // one. `on_progress`: called with a line for people. Returns false if `end_requested` was true
  // before the end. Throws the reason why there is no volume; clients get it, too.
  bool LoadFirst(const std::function<void(const std::string&)>& on_progress,
                 const LoadCancelled& end_requested);
  // A clean end, once nobody can change anything any more.
  void End();

 private:
  const LoadedConfig& loaded_;
  const DaemonPaths& paths_;
  Instrument& instrument_;
  RegistrationStore registrations_;

 public:
  Session session;
  VolumeEditor editor;
  RecordingControl recording;
  SeriesPlayer series;

 private:
  std::optional<HandGuide> hand_guide_;
  const std::shared_ptr<StylusTools> tools_;
  SessionKeeper keeper_;
  SessionLeft left_;
};

}  // namespace palpate
