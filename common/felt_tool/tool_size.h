// How large a rigid tool is: in words, and the scale at which its balls can be felt.
//
// Lengths in mm of the device, unless they say "of the volume". Threads: pure functions.
#pragma once

#include <optional>
#include <string>

#include "common/contract/render.h"

namespace palpate {

// Radii of balls in voxels of the shortest edge. Smaller ones mean nothing on the lattice; larger
// ones take too long.
inline constexpr double kLeastBallVoxels = 0.3;
inline constexpr double kMostBallVoxels = 8.0;

// All lengths times `scale`; the rotation length within its range.
HeldTool Scaled(HeldTool tool, double scale);

// The scale next to 1 at which all balls of the tool can be felt, with few digits, to be typed.
// 1: they can as they are. None: no scale helps. `voxel_mm`: the shortest edge of a voxel.
std::optional<double> FittingScale(const HeldTool& tool, double voxel_mm);
// The same for the volume, which is magnified instead.
std::optional<double> FittingMagnification(const HeldTool& tool, double voxel_mm);

// "drill: 39 balls of radius 1.5 to 3 mm, up to 61.5 mm from the tip; 1 carves"
std::string InWords(const HeldTool& tool);
// "15 mm thick and 156 mm long in the volume", of which one mm is `device_mm_per_mm` on the device.
std::string SizeInVolume(const HeldTool& tool, double device_mm_per_mm);

}  // namespace palpate
