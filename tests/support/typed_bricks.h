// Volumes as clients hold them: bricks of chosen types, tiles and background in an oblique frame.
#pragma once

#include <array>
#include <limits>
#include <random>
#include <vector>

#include "common/bricks/brick_map.h"
#include "common/bricks/volume_event.h"

namespace palpate::testing {

struct TypedVolume {
  VolumeLattice lattice;
  BrickMap bricks{};
};

inline VolumeLattice ObliqueLattice(const Vec3i& size, bool is_mirrored = false) {
  VolumeLattice lattice;
  lattice.source = "scan.nrrd";
  lattice.size = size;
  lattice.spacing_mm = Vec3(0.4882812, 0.7, 1.25);
  lattice.value_min = -30000.0;
  lattice.value_max = 60000.0;
  lattice.unit = "HU";
  Mat3 axes = Eigen::AngleAxisd(0.9, Vec3(1, -2, 3).normalized()).toRotationMatrix();
  if (is_mirrored) axes.col(1) *= -1;
  lattice.X_WI = {axes * lattice.spacing_mm.asDiagonal(), Vec3(-123.25, 77.1, 1e3 / 3)};
  return lattice;
}

// Numbers of the whole range of T; of floats also -0.
template <class T>
TypedBrickPtr NoiseBrick(std::mt19937& random) {
  std::array<T, kBrickVoxels> values;
  for (T& value : values) {
    if constexpr (std::is_same_v<T, float>) {
      value = std::uniform_real_distribution<float>(-30000, 60000)(random);
      if (random() % 16 == 0) value = -0.0f;
    } else {
      value = static_cast<T>(random());
    }
  }
  return TypedBrick::Of<T>(values);
}

// Bricks of these types by turns; every third is background, every fifth has another value.
// Beyond the lattice there is noise, too.
inline TypedVolume NoiseVolume(const Vec3i& size, const std::vector<LeafType>& types,
                               float background, unsigned seed = 1) {
  TypedVolume volume{ObliqueLattice(size, seed % 2 == 1)};
  volume.lattice.value_min = background;
  volume.lattice.type = types.front();
  volume.bricks =
      BrickMap(volume.lattice.BrickCounts(), TypedBrick::Constant(volume.lattice.type, background));
  std::mt19937 random(seed);
  for (std::uint64_t number = 0; number < volume.bricks.size(); ++number) {
    const LeafType type = types[number % types.size()];
    if (number % 3 == 2) continue;
    volume.bricks.Put(number, number % 5 == 4 ? TypedBrick::Constant(type, 7.0f)
                                              : VisitType(type, [&](auto voxel) {
                                                  return NoiseBrick<decltype(voxel)>(random);
                                                }));
  }
  return volume;
}

}  // namespace palpate::testing
