// Volumes, surfaces and strokes for targets that run ticks. They are small and have flat regions,
// slopes, ties and edges.
#pragma once

#include <array>
#include <cmath>
#include <memory>

#include "server/recording/sample_fields.h"
#include "server/scene/scene.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/made_volume.h"

namespace palpate::fuzz {

// 12 x 10 x 9 voxels: eight bricks, most of them partly beyond the lattice.
inline std::shared_ptr<const VolumeSnapshot> SmallVolume() {
  static const auto volume = testing::MakeVolume({12, 10, 9}, [](int i, int j, int k) {
    if (i < 3) return j < 5 ? 0.0 : 8.0;
    if (k > 6) return static_cast<double>((i * 7 + j * 5 + k * 3) % 9);
    return 4.0 + 4.0 * std::sin(0.9 * i) * std::cos(0.8 * j) + 0.5 * k;
  });
  return volume;
}

// 3 mm voxels, rotated and slightly sheared, around the origin of D.
inline AffineMap SmallPlacement() {
  AffineMap X_DI;
  X_DI.linear = Eigen::AngleAxisd(0.4, Vec3(1, 2, 3).normalized()).toRotationMatrix() * 3.0;
  X_DI.linear(0, 1) += 0.1;
  X_DI.translation = X_DI.linear * Vec3(-5.5, -4.5, -4.0);
  return X_DI;
}

inline bool IsSameSample(const TickSample& a, const TickSample& b) {
  bool same = true;
  std::array<const void*, 64> fields{};
  std::size_t n = 0;
  VisitFields(a, [&](std::string_view, const auto& field) { fields.at(n++) = &field; });
  n = 0;
  VisitFields(b, [&](std::string_view, const auto& field) {
    same = same && std::memcmp(fields[n++], &field, sizeof field) == 0;
  });
  return same;
}

}  // namespace palpate::fuzz
