// The session: the volume and the settings that are felt, what changes them, and what is kept of
// them.
//
// Threads: main.
// Errors: Error.
#pragma once

#include <memory>
#include <optional>

#include "server/app/config.h"
#include "server/app/daemon_paths.h"
#include "server/app/first_volume.h"
#include "server/app/instrument.h"
#include "server/kept/registration_store.h"
#include "server/kept/session_keeper.h"
#include "server/recording/recording_control.h"
#include "server/session/edits/volume_editor.h"
#include "server/session/series/series_player.h"
#include "server/session/session.h"
#include "server/session/tools/tools.h"
#include "server/simulated_hand/hand_guide.h"

namespace palpate {

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
