// Stores a session in a TOML file from which it can be restored.
//
// Units as in scene.h. Threads: any; not for real-time code.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "server/felt/scene.h"
#include "server/live_volume/volume_loader.h"

namespace palpate {

// The volume and the settings that are felt.
struct FeltSession {
  LoadRequest volume{};  // no source: cannot be loaded again (an upload or a series)
  RenderSettings settings{};
  std::uint64_t settings_revision = 0;
};

struct SavedSession {
  // The configuration's values at start: source, spacing, scale and isovalue.
  LoadRequest configured{};
  RenderSettings configured_settings{};  // without the isovalue
  int attempts = 0;                      // failed attempts to restore the session
  bool ended_cleanly = false;            // the daemon, which had saved all
  FeltSession felt{};
};

struct SessionFile {
  std::optional<SavedSession> session;  // none: no such file, or a damaged one
  std::string damage;                   // one line; empty: none
};

SessionFile ReadSessionFile(const std::filesystem::path& path);

// Afterwards the file is either complete or unchanged. Leaves out a source that a TOML file cannot
// hold (a path need not be UTF-8). Throws Error (kUnavailable).
void WriteSessionFile(const std::filesystem::path& path, const SavedSession& session);

}  // namespace palpate
