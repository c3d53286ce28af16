// The readers of palpate-import, one per family of formats.
//
// One thread. Not for real-time code. Errors: palpate::Error without the file's
// name; what the libraries throw passes through.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "server/import/data_check.h"
#include "server/import/dense_volume.h"
#include "server/import/image_header.h"
#include "server/import/reporter.h"
#include "server/volume/raw_voxels.h"

namespace palpate {

// NRRD and NIfTI, one frame of it; 0 unless stated, with a warning when there are
// more. By our own means: ITK reads neither NIfTI-2 nor NRRD series in space, and
// lets units and a slope of 0 go wrong.
DenseVolume ReadPlainVolume(const std::filesystem::path& path, ImageFormat format,
                            const std::optional<std::int64_t>& frame, const ImportLimits& limits,
                            Reporter* reporter);

// Nothing but voxels; spacing 1 mm.
DenseVolume ReadRawVolume(const std::filesystem::path& path, const RawVoxels& raw,
                          const ImportLimits& limits, Reporter* reporter);

// A TIFF stack, see tiff_stack.h; spacing 1 mm, since TIFF states none along z.
DenseVolume ReadTiffVolume(const std::filesystem::path& input, const ImportLimits& limits,
                           Reporter* reporter);

// MetaImage through ITK, which delivers LPS.
DenseVolume ReadMetaImageVolume(const std::filesystem::path& path, const ImportLimits& limits,
                                Reporter* reporter);

// The largest series of a folder: slices sorted by position, which must be
// parallel and about evenly spaced. CT is in HU.
DenseVolume ReadDicomVolume(const std::filesystem::path& folder, const ImportLimits& limits,
                            Reporter* reporter);

struct VdbOptions {
  std::string source;                // as the volume is named
  std::string grid{};                // which one of several
  std::string component{};           // of a grid of vectors: magnitude, x, y or z
  std::optional<Vec3> spacing_mm{};  // instead of the file's
};

// A grid of a .vdb file, from anywhere: handed over as it is (server/volume/handover.h). The leaves
// around its active voxels become the volume; its world unit is taken for mm.
void HandOverVdb(const std::filesystem::path& path, const VdbOptions& options, int fd,
                 Reporter* reporter);

}  // namespace palpate
