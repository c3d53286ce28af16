// The properties of a volume besides its voxels. Plain values, no OpenVDB.
//
// Frames: I voxel index (voxel (0,0,0) is the first of the file), W world (mm, LPS as in DICOM).
// Values are in the data's own units.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
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
  // The values are signed distances from a surface at 0, negative inside. All space beyond the
  // lattice is outside.
  bool is_level_set = false;
  int frames = 1;  // number of frames in the source; the volume is one of them
  // Of a series: which one, from 0 on; in between, two are blended. None: no series.
  std::optional<double> series_position_frames{};
  std::string unit;  // "HU", ...; empty: not stated
  // The values that the file proposes for pictures: level - width / 2 to level + width / 2. Width
  // 0: the file proposes none.
  double window_level = 0.0;
  double window_width = 0.0;
  // Where +x, +y and +z of W point in the patient: three of L, R, P, A, S, I. "LPS" if the file
  // states an orientation, because W is LPS then. Empty: unknown.
  std::string patient_axes;
  std::string original_type;  // "uint8", "int16", "float64", ...
  std::string source;         // file name, folder name or builtin name
  // Assumptions and omissions of the import, in the words shown to clients. Not saved in files.
  std::vector<std::string> warnings;
  // True if loading `source` again gives this volume. False for uploads, series, raw voxels, a
  // frame other than the first, and volumes loaded with a named grid or component.
  bool reloadable = true;
  // For a volume from a .vdb file: the rest of its grid, for saving (grid_tree.h).
  std::shared_ptr<const GridForm> grid_form{};

  // The value beyond the lattice, data units: the end of the range that is outside.
  double Background() const { return is_level_set ? value_max : value_min; }
  // Edits keep voxels within these. Whole numbers in a type of at most 16 bits: the type's range.
  // Otherwise value_min and value_max.
  std::pair<double, double> EditRange() const;
  AffineMap WorldFromIndex() const { return {direction * spacing_mm.asDiagonal(), origin_W_mm}; }
};

// The range of allowed spacings, mm. For a finer spacing, OpenVDB takes the determinant for zero.
inline constexpr double kLeastSpacingMm = 1e-4;
inline constexpr double kGreatestSpacingMm = 1e6;

// The most bytes of unit, original type and source.
inline constexpr std::size_t kLongestText = 4096;

// True for three letters that name a direction along each of the patient's axes, such as "LPS".
inline bool IsPatientAxes(std::string_view axes) {
  const auto has = [axes](char one, char other) {
    return (axes.find(one) == axes.npos) != (axes.find(other) == axes.npos);
  };
  return axes.size() == 3 && has('L', 'R') && has('P', 'A') && has('S', 'I');
}

// Throws Error(kInvalidArgument) with one clear line if size, spacing, frame, range or patient axes
// are invalid for a volume.
void CheckVolumeMetadata(const VolumeMetadata& metadata);

// "24 x 24 x 8 voxels of 1 x 1 x 5 mm"
std::string ShapeText(const Vec3i& size, const Vec3& spacing_mm);

}  // namespace palpate
