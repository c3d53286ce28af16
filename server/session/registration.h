// Where a volume lies in the device's workspace.
//
// Frames: D device (mm), W world (mm), I voxel index. X_DW is a similarity.
// Threads: pure.
#pragma once

#include <optional>

#include "common/geometry/geometry.h"
#include "server/device/haptic_device.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

struct Registration {
  double device_mm_per_volume_mm = 1.0;
  AffineMap X_DW;
};

// Share of the workspace that a fitted volume fills, so that the stylus can go
// round it.
inline constexpr double kWorkspaceFill = 0.9;

// The middle of the volume in the middle of the workspace, axes of W along those
// of D, uniformly scaled so that its bounding box fits, or by the given scale.
Registration FitToWorkspace(const VolumeMetadata& volume, const DeviceSpec& device,
                            std::optional<double> device_mm_per_volume_mm);

}  // namespace palpate
