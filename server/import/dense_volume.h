// A volume as the readers deliver it, and the last steps that all formats share.
//
// Threads: one. Not for real-time code.
#pragma once

#include <memory>
#include <optional>

#include "server/import/reporter.h"
#include "server/volume/leaf_type.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

struct DenseVolume {
  std::unique_ptr<float[]> voxels;  // x fastest, metadata.size of them
  VolumeMetadata metadata;          // without the value range and the source
};

// Replaces voxels that are not finite by the least finite value, and sets the value range. Warns of
// replaced voxels, and where 32 bit floats do not hold what the file has. Throws Error
// (kInvalidArgument) for a constant volume or an unsupported geometry.
void FinishVolume(DenseVolume* volume, const std::optional<Vec3>& spacing_mm, Reporter* reporter);

// Returns the type in which the voxels are held: the file's own, or the smallest type that holds
// each voxel exactly.
LeafType HeldType(const DenseVolume& volume);

}  // namespace palpate
