// Gets a volume from its source: a builtin name, or a path. palpate-import reads the path in a
// process of its own. Prepares its warnings for clients.
//
// Threads: any ordinary thread; blocks until done. Errors: Error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/files/own_files.h"
#include "server/haptics/settings.h"
#include "server/live_volume/memory_budget.h"
#include "server/volume/load/dense_bricks.h"
#include "server/volume/load/import_process.h"

namespace palpate {

struct LoadRequest {
  std::string source;
  bool source_stays = true;          // false: remove the source after the load
  std::string title{};               // the volume's name; empty: the source
  std::optional<double> isovalue{};  // data units
  std::optional<double> normalized_isovalue{};
  std::optional<Vec3> spacing_mm{};
  std::optional<double> device_mm_per_volume_mm{};
  std::optional<RawVoxels> raw{};       // the file holds only these, without a header
  std::optional<std::int64_t> frame{};  // for a file with several frames
  std::string grid{};                   // for a .vdb file with several grids
  std::string component{};              // for a grid of vectors: magnitude, x, y or z
  std::optional<FreeSide> free_side{};  // replaces the default for the volume
  bool discards_edits = false;          // of the volume before that are not saved
  std::string warning{};                // shown with those of the import; empty: none
};

using LoadProgress = std::function<void(std::string_view stage, double fraction)>;
using LoadCancelled = std::function<bool()>;

// Called with the size in the file's header before voxels are read, and again with the imported
// size and type. An exception from this function ends the load.
using LoadSizeKnown = std::function<void(const Vec3i& size, const LoadMemory& memory)>;

struct VolumeLoader {
  std::filesystem::path import_program;
  // As in ImportRequest.
  std::optional<std::vector<std::filesystem::path>> folders{};
  OwnFiles own_files{};
  std::int64_t max_voxels = std::int64_t{1} << 31;
  std::int64_t max_memory_bytes = std::int64_t{16} << 30;  // of the importer
  std::shared_ptr<MemoryBudget> budget = MemoryBudget::Make();

  // `warnings`: one line each, for the log. Claims nothing of the budget; `size_known` must do
  // that.
  LoadedVolume Load(const LoadRequest& request, const LoadProgress& progress,
                    const LoadCancelled& cancelled, std::vector<std::string>& warnings,
                    const LoadSizeKnown& size_known = {}) const;
};

// Prepares the warnings of an import for clients.
//
// Removes the name of `source` from the start of each warning, because clients know the source
// under another name. Each line is UTF-8 of at most 300 bytes. Returns at most 16 lines; if there
// are more warnings, the last line counts the rest.
std::vector<std::string> WarningsForClients(std::span<const std::string> warnings,
                                            std::string_view source);

}  // namespace palpate
