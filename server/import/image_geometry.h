// Compares places of a file's voxels, and puts axes at right angles.
//
// Frames: I voxel index, W world (mm). Pure. Threads: any. Errors: none.
#pragma once

#include <array>
#include <cstdint>

#include "server/import/image_header.h"

namespace palpate {

// A voxel counts as off by the axis along which it is farthest from its place, in voxels. Up to
// kSlightlyOff nothing is said. Beyond kFarOff the place is wrong.
inline constexpr double kSlightlyOff = 0.1;
inline constexpr double kFarOff = 0.5;

struct PlaceError {
  double voxels = 0.0;
  double mm = 0.0;
};

// Maps the index to W.
AffineMap MapOf(const ImageGeometry& geometry);

// How far the two places of a corner voxel are from each other at most, in voxels of X_WI. Infinite
// if the places are not finite.
PlaceError FarthestCorner(const AffineMap& X_WI, const AffineMap& other_WI,
                          const std::array<std::int64_t, 3>& size);

// Turns an axis with a negative spacing around, as ITK does, and warns. Warns of a spacing that is
// assumed, unless the user states it.
void RepairSpacing(bool spacing_is_given, ImageHeader* header);

// Replaces axes that are not at right angles by the nearest ones that are; spacing and the volume's
// middle stay. Returns how far that moves a corner voxel at most.
PlaceError Straighten(const std::array<std::int64_t, 3>& size, ImageGeometry* geometry);

}  // namespace palpate
