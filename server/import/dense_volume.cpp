#include "server/import/dense_volume.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include "common/error/error.h"

namespace palpate {
namespace {

void SetRange(DenseVolume* volume, Reporter* reporter) {
  float* const begin = volume->voxels.get();
  float* const end = begin + volume->metadata.size.cast<std::int64_t>().prod();
  float least = std::numeric_limits<float>::infinity();
  float greatest = -least;
  std::int64_t odd = 0;
  for (const float* voxel = begin; voxel != end; ++voxel) {
    if (!std::isfinite(*voxel)) {
      ++odd;
      continue;
    }
    least = std::min(least, *voxel);
    greatest = std::max(greatest, *voxel);
  }
  if (odd == end - begin) {
    throw Error(ErrorKind::kInvalidArgument,
                "no voxel is a finite number of float range; there is nothing to feel");
  }
  if (odd > 0) {
    std::replace_if(
        begin, end, [](float value) { return !std::isfinite(value); }, least);
    reporter->Warn(std::to_string(odd) +
                   " voxels are not finite numbers of float range; they got the least value " +
                   std::to_string(least));
  }
  volume->metadata.value_min = least;
  volume->metadata.value_max = greatest;
}

// Voxels that no smaller type holds are held as 32 bit floats.
void WarnOfRounding(const DenseVolume& volume, Reporter* reporter) {
  constexpr double kFirstRounded = 1 << 24;  // also what 2^24 + 1 becomes
  const VolumeMetadata& metadata = volume.metadata;
  const bool is_integer = metadata.original_type == "int32" || metadata.original_type == "uint32";
  if (is_integer && std::max(-metadata.value_min, metadata.value_max) >= kFirstRounded) {
    reporter->Warn("integers of 2^24 and more are rounded to 32 bit floats, and so they are saved");
  } else if (metadata.original_type == "float64" && HeldType(volume) == LeafType::kFloat) {
    reporter->Warn("64 bit floats are rounded to 32 bit floats, and so they are saved");
  }
}

}  // namespace

void FinishVolume(DenseVolume* volume, const std::optional<Vec3>& spacing_mm, Reporter* reporter) {
  reporter->Progress(0.6, "converting");
  if (spacing_mm) volume->metadata.spacing_mm = *spacing_mm;
  SetRange(volume, reporter);
  CheckVolumeMetadata(volume->metadata);
  WarnOfRounding(*volume, reporter);
}

LeafType HeldType(const DenseVolume& volume) {
  const std::optional<LeafType> own = LeafTypeNamed(volume.metadata.original_type);
  const float* const begin = volume.voxels.get();
  const float* const end = begin + volume.metadata.size.cast<std::int64_t>().prod();
  const auto holds = [&](LeafType type) {
    return std::all_of(begin, end, [type](float value) { return Holds(type, value); });
  };
  // Scaled voxels may not fit the file's own type.
  if (own && holds(*own)) return *own;
  return *std::find_if(std::begin(kLeafTypes), std::end(kLeafTypes), holds);
}

}  // namespace palpate
