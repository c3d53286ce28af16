// The readers of palpate-import, one per family of formats.
//
// Threads: one. Not for real-time code. Errors: palpate::Error without the file's name. Exceptions
// of the libraries pass through.
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

// NRRD and NIfTI: reads one frame. Without `frame`, reads frame 0, and warns if there are more
// frames. We use our own code: ITK reads neither NIfTI-2 nor NRRD series in space, and treats units
// and a slope of 0 wrongly.
DenseVolume ReadPlainVolume(const std::filesystem::path& path, ImageFormat format,
                            const std::optional<std::int64_t>& frame, const ImportLimits& limits,
                            Reporter* reporter);

// Raw voxels; spacing 1 mm.
DenseVolume ReadRawVolume(const std::filesystem::path& path, const RawVoxels& raw,
                          const ImportLimits& limits, Reporter* reporter);

// A TIFF stack, see tiff_stack.h. Spacing 1 mm, because TIFF has none along z.
DenseVolume ReadTiffVolume(const std::filesystem::path& input, const ImportLimits& limits,
                           Reporter* reporter);

// MetaImage through ITK, which delivers LPS.
DenseVolume ReadMetaImageVolume(const std::filesystem::path& path, const ImportLimits& limits,
                                Reporter* reporter);

// The largest series of a folder. Slices are sorted by position and must be parallel and about
// evenly spaced. CT is in HU.
DenseVolume ReadDicomVolume(const std::filesystem::path& folder, const ImportLimits& limits,
                            Reporter* reporter);

struct VdbOptions {
  std::string source;                // the volume's name
  std::string grid{};                // for a file with several grids
  std::string component{};           // for a grid of vectors: magnitude, x, y or z
  std::optional<Vec3> spacing_mm{};  // replaces the file's
};

// Hands over a grid of a .vdb file of any program, without conversion (server/volume/handover.h).
// The leaves around its active voxels become the volume. The grid's world unit counts as mm.
void HandOverVdb(const std::filesystem::path& path, const VdbOptions& options, int fd,
                 Reporter* reporter);

}  // namespace palpate
