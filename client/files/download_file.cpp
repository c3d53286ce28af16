#include "client/files/download_file.h"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <filesystem>

#include "client/files/vdb_file.h"
#include "client/sdk/nrrd_file.h"
#include "common/error/error.h"
#include "common/files/new_file.h"

namespace palpate::client {
namespace {

enum class Format { kNrrd, kVdb };

Format FormatOf(const std::string& file) {
  std::string suffix = std::filesystem::path(file).extension();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  if (suffix == ".nrrd") return Format::kNrrd;
  if (suffix == ".vdb") return Format::kVdb;
  throw Error(ErrorKind::kInvalidArgument,
              file + ": the name must end with .nrrd or .vdb, which says the format");
}

// Before the transfer, so that nobody waits for it in vain. The file's type is not known yet: edits
// and import may make it larger or smaller than the original's, but all of floats stay floats.
void CheckSize(const VolumeInfo& volume) {
  const bool has_floats = volume.original_type.starts_with("float");
  CheckNrrdSize(volume.size, has_floats ? LeafType::kFloat : LeafType::kUint8);
}

DownloadResult Fetch(Calls& palpated, const ProgressFunction& progress) {
  try {
    return palpated.DownloadVolume(progress);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kCancelled) throw;
    throw Error(ErrorKind::kCancelled, "the download was cancelled; no file was written");
  }
}

void Write(const VolumeMirror& copy, const VolumeInfo& before, Format format,
           const std::string& file, bool overwrite, const std::function<void()>& check) {
  if (format == Format::kNrrd) {
    SaveAsNrrd(copy, file, overwrite, check);
    return;
  }
  VdbOrigin origin;
  // Another volume may have been loaded since.
  if (before.loaded_revision == copy.lattice()->loaded_revision) {
    origin = {before.original_type, static_cast<int>(before.frames),
              before.patient_axes_answered ? "" : before.patient_axes};
  }
  SaveAsVdb(copy.bricks(), *copy.lattice(), origin, file, overwrite, check);
}

}  // namespace

DownloadedFile DownloadToFile(Calls& palpated, const std::string& file, bool overwrite,
                              const ProgressFunction& progress,
                              const std::function<void()>& check) {
  const Format format = FormatOf(file);
  // Check the path before the volume is transferred.
  CheckNewFile(file, ReplacesIf(overwrite));
  const VolumeInfo before = palpated.GetVolume();
  if (format == Format::kNrrd) CheckSize(before);
  const auto begin = std::chrono::steady_clock::now();
  DownloadedFile file_written{.copy = Fetch(palpated, progress)};
  file_written.received_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  if (file_written.copy.volume.placement()->replayed) {
    throw Error(
        ErrorKind::kConflict,
        "a recording is replayed, and what came is the recorded volume: no file was written");
  }
  Write(file_written.copy.volume, before, format, file, overwrite, check);
  return file_written;
}

}  // namespace palpate::client
