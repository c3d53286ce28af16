// What is felt, as a TOML file from which it can be felt again.
//
// Units as in render_settings.h. Any thread; not for real-time code.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "server/scene/render_settings.h"
#include "server/store/volume_loader.h"

namespace palpate {

// What is felt, to be felt again.
struct FeltSession {
  LoadRequest volume{};    // no source: it cannot be loaded again, as an upload or a series
  bool is_edited = false;  // since it was loaded
  RenderSettings settings{};
  std::uint64_t settings_revision = 0;
};

struct SavedSession {
  // What the configuration had loaded at start: source, spacing, scale and isovalue.
  LoadRequest configured{};
  RenderSettings configured_settings{};  // but for the isovalue
  int attempts = 0;                      // to go on with it, none of which lasted
  FeltSession felt{};
};

struct SessionFile {
  std::optional<SavedSession> session;  // none: no such file, or a damaged one
  std::string damage;                   // one line; empty: none
};

SessionFile ReadSessionFile(const std::filesystem::path& path);

// The file is whole or as it was. A source that a TOML file cannot hold (a path need not
// be UTF-8) is left out. Throws Error (kUnavailable).
void WriteSessionFile(const std::filesystem::path& path, const SavedSession& session);

}  // namespace palpate
