// A volume as the readers deliver it, and the last steps that all formats share.
//
// One thread. Not for real-time code.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "server/import/reporter.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

struct DenseVolume {
  std::unique_ptr<float[]> voxels;  // x fastest, metadata.size of them
  VolumeMetadata metadata;          // all but the value range and the source
};

// Replaces voxels that are not finite by the least finite value (with a warning),
// sets the value range, and writes `output`. Throws Error(kInvalidArgument) for a
// constant volume or a geometry that is not supported.
void FinishVolume(DenseVolume volume, const std::optional<Vec3>& spacing_mm,
                  const std::filesystem::path& output, Reporter* reporter);

}  // namespace palpate
