// The readers of palpate-import, one per family of formats. They give the voxels to `sink`, and
// return the metadata without the value range and the source.
//
// Threads: one. Not for real-time code. Errors: palpate::Error without the file's name. Exceptions
// of the libraries pass through.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "server/import/data_check.h"
#include "server/import/image_header.h"
#include "server/import/reporter.h"
#include "server/import/voxel_reader.h"
#include "server/volume/load/import_process.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// NRRD, MetaImage and NIfTI: reads one frame. Without `frame`, reads frame 0, and warns if there
// are more frames. We use our own code: ITK reads neither NIfTI-2 nor NRRD series in space, treats
// units and a slope of 0 wrongly, and crashes on long MetaImage comments.
VolumeMetadata ReadPlainVolume(const std::filesystem::path& path, ImageFormat format,
                               const std::optional<std::int64_t>& frame, const ImportLimits& limits,
                               const VoxelSink& sink, Reporter* reporter);

// Raw voxels; spacing 1 mm.
VolumeMetadata ReadRawVolume(const std::filesystem::path& path, const RawVoxels& raw,
                             const ImportLimits& limits, const VoxelSink& sink, Reporter* reporter);

// A TIFF stack, see tiff_stack.h. Refuses one without a spacing, unless the user gives it.
VolumeMetadata ReadTiffVolume(const std::filesystem::path& input, const ImportLimits& limits,
                              const VoxelSink& sink, Reporter* reporter);

// The largest stack of parallel slices of a folder, or of the folders below it; what is left out is
// said. Slices are sorted by position and must lie on one line across them. Unevenly spaced slices
// are resampled at their finest spacing, with a warning. The unit is HU where the rescale leads to
// it.
VolumeMetadata ReadDicomVolume(const std::filesystem::path& folder, const ImportLimits& limits,
                               const VoxelSink& sink, Reporter* reporter);

struct VdbOptions {
  std::string source;                // the volume's name
  std::string grid{};                // for a file with several grids
  std::string component{};           // for a grid of vectors: magnitude, x, y or z
  std::optional<Vec3> spacing_mm{};  // replaces the file's
};

// Hands over a grid of a .vdb file of any program, without conversion
// (server/volume/load/handover.h). The leaves around its active voxels become the volume. The
// grid's world unit counts as mm.
void HandOverVdb(const std::filesystem::path& path, const VdbOptions& options, int fd,
                 Reporter* reporter);

}  // namespace palpate
