#include "server/live_volume/volume_loader.h"

#include <algorithm>
#include <cstddef>

#include "common/error/error.h"
#include "common/error/text.h"
#include "server/volume/load/builtin.h"
#include "server/volume/load/import_process.h"
#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace palpate {
namespace {

// Two floats (the dense copy and the grid), and an eighth more.
constexpr std::int64_t kBytesPerBuiltinVoxel = 9;

}  // namespace

LoadedVolume VolumeLoader::Load(const LoadRequest& load, const LoadProgress& progress,
                                const LoadCancelled& cancelled, std::vector<std::string>& warnings,
                                const LoadSizeKnown& size_known) const {
  const std::string& source = load.source;
  if (IsBuiltin(source)) {
    if (load.raw || load.frame.value_or(0) != 0 || !load.grid.empty() || !load.component.empty()) {
      throw Error(
          ErrorKind::kInvalidArgument,
          source +
              ": a builtin volume takes no raw voxels, frame, grid or component: leave them out");
    }
    const Vec3i size = BuiltinSize(source);
    if (size_known) {
      const auto voxels = static_cast<std::uint64_t>(size.cast<std::int64_t>().prod());
      size_known(size, {.passing_bytes = kBytesPerBuiltinVoxel * voxels});
    }
    progress("making", 0.0);
    const std::int64_t max_builtin_voxels =
        std::min<std::int64_t>(max_voxels, max_memory_bytes / kBytesPerBuiltinVoxel);
    BuiltinVolume volume =
        MakeBuiltin(source, load.spacing_mm.value_or(Vec3::Ones()), max_builtin_voxels, cancelled);
    return {volume.metadata, TakeBricks(*volume.grid, volume.metadata.size)};
  }
  if (source.find('\0') != std::string::npos) {
    throw Error(ErrorKind::kInvalidArgument, "the path holds a NUL character");
  }
  if (!std::filesystem::path(source).is_absolute()) {
    throw Error(ErrorKind::kInvalidArgument,
                source + ": the path must be absolute, or a builtin volume such as builtin:bumps");
  }
  ImportRequest request;
  request.source = source;
  request.spacing_mm = load.spacing_mm;
  request.raw = load.raw;
  request.frame = load.frame;
  request.grid = load.grid;
  request.component = load.component;
  request.folders = folders;
  request.own_files = own_files;
  request.max_voxels = max_voxels;
  request.max_memory_bytes = max_memory_bytes;
  request.import_program = import_program;
  request.on_size = size_known;
  return ImportVolume(request, progress, cancelled, &warnings);
}

namespace {

constexpr std::size_t kMostLines = 16;
constexpr std::size_t kMostBytes = 300;

std::string Fit(std::string_view text) {
  std::string fit;
  while (!text.empty()) {
    const std::size_t bytes = Utf8CharacterBytes(text);
    const std::string_view next = bytes == 0 ? "?" : text.substr(0, bytes);
    if (fit.size() + next.size() > kMostBytes) break;
    fit += next;
    text.remove_prefix(next.size());
  }
  return OneLine(fit);
}

}  // namespace

std::vector<std::string> WarningsForClients(std::span<const std::string> warnings,
                                            std::string_view source) {
  const std::string prefix = std::string(source) + ": ";
  const std::size_t shown = warnings.size() > kMostLines ? kMostLines - 1 : warnings.size();
  std::vector<std::string> lines;
  for (std::string_view warning : warnings.first(shown)) {
    if (warning.starts_with(prefix)) warning.remove_prefix(prefix.size());
    lines.push_back(Fit(warning));
  }
  if (shown < warnings.size()) {
    lines.push_back("and " + std::to_string(warnings.size() - shown) + " more");
  }
  return lines;
}

}  // namespace palpate
