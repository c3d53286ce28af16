// Loads the volume that is felt when the daemon starts.
//
// Threads: main. Errors: Error.
#pragma once

#include <functional>
#include <string>

#include "server/app/config.h"
#include "server/session/session.h"
#include "server/state/session_keeper.h"

namespace palpate {

LoadRequest ConfiguredVolume(const Config& config);
RenderSettings ConfiguredSettings(const Config& config);

// Restores the session of the previous daemon if that daemon was killed. Otherwise loads the
// configured volume, also if the restore fails or if `paths` no longer allows the session's volume.
// The log says why. Tells the progress to the session's first_load(), as a line for people to
// `on_progress`, and every five seconds to the log.
void LoadFirstVolume(const LoadedConfig& loaded, Session& session, SessionKeeper& keeper,
                     const PathPolicy& paths,
                     const std::function<void(const std::string&)>& on_progress,
                     const LoadCancelled& cancelled);

}  // namespace palpate
