// What is felt when the daemon starts.
//
// Threads: main, before the servo runs. Errors: Error.
#pragma once

#include "server/app/config.h"
#include "server/session/session.h"
#include "server/state/session_keeper.h"

namespace palpate {

LoadRequest ConfiguredVolume(const Config& config);
RenderSettings ConfiguredSettings(const Config& config);

// Loads what was felt when the daemon before was killed, or the configured volume with
// the configured settings. The first may fail, or not be allowed any more by `paths`:
// then it is said in the log.
void LoadFirstVolume(const LoadedConfig& loaded, Session& session, SessionKeeper& keeper,
                     const PathPolicy& paths, const LoadCancelled& cancelled);

}  // namespace palpate
