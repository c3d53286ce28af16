// Loads the volume that is felt when the daemon starts.
//
// Threads: main, before the servo runs. Errors: Error.
#pragma once

#include "server/app/config.h"
#include "server/session/session.h"
#include "server/state/session_keeper.h"

namespace palpate {

LoadRequest ConfiguredVolume(const Config& config);
RenderSettings ConfiguredSettings(const Config& config);

// Restores the session of the previous daemon if that daemon was killed. Otherwise loads the
// configured volume with the configured settings, also if the restore fails or if `paths` no longer
// allows the session's volume. The log says why.
void LoadFirstVolume(const LoadedConfig& loaded, Session& session, SessionKeeper& keeper,
                     const PathPolicy& paths, const LoadCancelled& cancelled);

}  // namespace palpate
