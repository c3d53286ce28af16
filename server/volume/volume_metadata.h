// What is known of a volume besides its voxels. Plain values, no OpenVDB.
//
// Frames: I voxel index (voxel (0,0,0) is the first of the file), W world (mm,
// LPS as in DICOM). Values are in the data's own units.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate {

struct GridForm;

struct VolumeMetadata {
  Vec3i size = Vec3i::Zero();         // voxels along x, y, z, each at least 2
  Vec3 spacing_mm = Vec3::Ones();     // positive
  Vec3 origin_W_mm = Vec3::Zero();    // centre of voxel (0,0,0)
  Mat3 direction = Mat3::Identity();  // columns: unit vectors of the index axes in W
  double value_min = 0.0;             // range over the whole volume, value_min < value_max
  double value_max = 1.0;
  // Signed distances from a surface at 0, negative inside: beyond the lattice it goes on as
  // outside.
  bool is_level_set = false;
  int frames = 1;             // of the source, one of which this volume is
  std::string unit;           // "HU", ...; empty: not stated
  std::string original_type;  // "uint8", "int16", "float64", ...
  std::string source;         // file name, folder name or builtin name
  // What the import assumed or left out, as clients are told; not kept in files.
  std::vector<std::string> warnings;
  // Loading `source` again gives this volume. Not so: uploads, series, one of several frames,
  // raw voxels.
  bool reloadable = true;
  // Of a volume out of a .vdb file: what else its grid was, for when it is saved (grid_form.h).
  std::shared_ptr<const GridForm> grid_form{};

  // Beyond the lattice, data units: the end of the range that is outside.
  double Background() const { return is_level_set ? value_max : value_min; }
  AffineMap WorldFromIndex() const { return {direction * spacing_mm.asDiagonal(), origin_W_mm}; }
};

// Spacings that a volume may have, mm: the determinant of a finer one is zero to
// OpenVDB.
inline constexpr double kLeastSpacingMm = 1e-4;
inline constexpr double kGreatestSpacingMm = 1e6;

// Of unit, original type and source, bytes.
inline constexpr std::size_t kLongestText = 4096;

// Throws Error(kInvalidArgument) with one clear line when sizes, spacing, frame
// or range are not those of a volume.
void CheckVolumeMetadata(const VolumeMetadata& metadata);

}  // namespace palpate
