// Loads the volume that is felt when the daemon starts.
//
// Threads: main. Errors: Error.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "server/app/config.h"
#include "server/kept/session_keeper.h"
#include "server/session/session.h"

namespace palpate {

LoadRequest ConfiguredVolume(const Config& config);
RenderSettings ConfiguredSettings(const Config& config);

// What the previous daemon has left, and what of it is lost.
struct SessionLeft {
  std::optional<FeltSession> felt{};
  std::string lost{};          // in words for clients; empty: nothing
  std::string bad_settings{};  // why `felt` cannot come back; empty: it can
};

// Takes it, and sets its settings. Call it before any client can set others.
SessionLeft TakeLeft(const Config& config, Session& session, SessionKeeper& keeper);

// Restores the volume of the previous daemon. Otherwise loads the configured volume, also if the
// restore fails or if `paths` no longer allows the session's volume. The log and the volume's
// warnings say why. Tells the progress to the session's first_load(), as a line for people to
// `on_progress`, and every five seconds to the log.
void LoadFirstVolume(const LoadedConfig& loaded, Session& session, const SessionLeft& left,
                     bool ended_cleanly, const PathPolicy& paths,
                     const std::function<void(const std::string&)>& on_progress,
                     const LoadCancelled& cancelled);

}  // namespace palpate
