// Volumes of noise in an oblique frame, for tests of files.
#pragma once

#include <random>

#include "tests/support/made_volume.h"

namespace palpate::testing {

// Has some constant bricks of the least value.
inline std::shared_ptr<const VolumeSnapshot> ObliqueVolume(const Vec3i& size, unsigned seed) {
  std::mt19937 random(seed);
  const auto plain = MakeVolume(size, [&](int i, int j, int k) {
    if (i + j + k == 0) return 1700.5;
    if ((i / 8 + j / 8 + k / 8) % 3 == 0) return -1024.0;
    return std::uniform_real_distribution<double>(-1024, 1700)(random);
  });
  VolumeMetadata metadata = plain->metadata();
  metadata.spacing_mm = Vec3(0.4882812, 0.7, 1.25);
  metadata.origin_W_mm = Vec3(-123.25, 77.1, 1e3 / 3);
  metadata.direction =
      Eigen::AngleAxisd(0.3 + seed, Vec3(1, -2, 3).normalized()).toRotationMatrix();
  metadata.unit = "HU";
  metadata.original_type = "float32";
  metadata.source = "oblique";
  return std::make_shared<VolumeSnapshot>(metadata, plain->bricks(), 1, 1);
}

}  // namespace palpate::testing
