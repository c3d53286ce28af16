// The readers of palpate-import, one per family of formats.
//
// One thread. Not for real-time code. Errors: palpate::Error without the file's
// name; what the libraries throw passes through.
#pragma once

#include <filesystem>

#include "server/import/data_check.h"
#include "server/import/dense_volume.h"
#include "server/import/image_header.h"
#include "server/import/reporter.h"

namespace palpate {

// NRRD, MetaImage and NIfTI-1 through ITK, which delivers LPS for all of them.
DenseVolume ReadItkVolume(const std::filesystem::path& path, ImageFormat format,
                          const ImportLimits& limits, Reporter* reporter);

// The largest series of a folder: slices sorted by position, which must be
// parallel and about evenly spaced. CT is in HU.
DenseVolume ReadDicomVolume(const std::filesystem::path& folder, const ImportLimits& limits,
                            Reporter* reporter);

// A .vdb file with one scalar grid, from anywhere. The box of its active voxels
// becomes the volume; its world unit is taken for mm.
DenseVolume ReadVdbVolume(const std::filesystem::path& path, const ImportLimits& limits,
                          Reporter* reporter);

}  // namespace palpate
