#include "tests/support/made_volume.h"

#include <algorithm>
#include <cmath>

namespace palpate::testing {

LeafPtr FilledLeaf(float value) {
  Brick brick;
  brick.fill(value);
  return Leaf::Of(LeafType::kFloat, brick);
}

BrickDirectory MakeBricks(const Vec3i& size, const std::function<float(int, int, int)>& value) {
  return BrickDirectory(size, [&](const Vec3i& brick) {
    Brick made{};
    const Vec3i first = brick * kBrickEdge;
    for (int n = 0; n < kBrickVoxels; ++n) {
      const int i = first.x() + (n >> 6), j = first.y() + (n >> 3 & 7), k = first.z() + (n & 7);
      if (i < size.x() && j < size.y() && k < size.z()) made[n] = value(i, j, k);
    }
    return Leaf::Of(LeafType::kFloat, made);
  });
}

std::shared_ptr<const VolumeSnapshot> MakeVolume(const Vec3i& size,
                                                 const std::function<double(int, int, int)>& value,
                                                 std::uint64_t revision) {
  double min = 1e300, max = -1e300;
  const BrickDirectory bricks = MakeBricks(size, [&](int i, int j, int k) {
    const auto stored = static_cast<float>(value(i, j, k));
    min = std::min<double>(min, stored);
    max = std::max<double>(max, stored);
    return stored;
  });
  VolumeMetadata metadata;
  metadata.size = size;
  metadata.value_min = min;
  metadata.value_max = max;
  return std::make_shared<VolumeSnapshot>(metadata, bricks.AllChangedAt(revision), revision,
                                          revision);
}

std::shared_ptr<const VolumeSnapshot> VolumeOfLeaves(
    const Vec3i& size, const std::function<LeafPtr(const Vec3i&)>& leaf, double value_min,
    double value_max) {
  VolumeMetadata metadata;
  metadata.size = size;
  metadata.value_min = value_min;
  metadata.value_max = value_max;
  return std::make_shared<VolumeSnapshot>(metadata, BrickDirectory(size, leaf), 1, 1);
}

std::vector<BrickChange> PaintedBox(const BrickDirectory& bricks, const Vec3i& from,
                                    const Vec3i& end, const std::function<float()>& value) {
  std::vector<BrickChange> changes;
  Vec3i b;
  for (b.x() = from.x() / 8; b.x() * 8 < end.x(); ++b.x()) {
    for (b.y() = from.y() / 8; b.y() * 8 < end.y(); ++b.y()) {
      for (b.z() = from.z() / 8; b.z() * 8 < end.z(); ++b.z()) {
        Brick made = bricks.At(b)->Floats();
        for (int n = 0; n < kBrickVoxels; ++n) {
          const Vec3i p = b * 8 + Vec3i(n >> 6, n >> 3 & 7, n & 7);
          const bool inside = (p.array() >= from.array()).all() && (p.array() < end.array()).all();
          if (inside) made[n] = value();
        }
        changes.push_back({b, Leaf::Of(LeafType::kFloat, made)});
      }
    }
  }
  return changes;
}

std::shared_ptr<const VolumeSnapshot> WithChanges(const VolumeSnapshot& volume,
                                                  std::span<const BrickChange> changes) {
  const std::uint64_t revision = volume.revision() + 1;
  return std::make_shared<const VolumeSnapshot>(volume.metadata(),
                                                volume.bricks().With(changes, revision), revision,
                                                volume.loaded_revision());
}

std::shared_ptr<const VolumeSnapshot> Renumbered(const VolumeSnapshot& volume,
                                                 std::uint64_t revision) {
  const BrickChange same{Vec3i::Zero(), volume.bricks().At(Vec3i::Zero())};
  return std::make_shared<const VolumeSnapshot>(volume.metadata(),
                                                volume.bricks().With({&same, 1}, revision),
                                                revision, volume.loaded_revision());
}

std::shared_ptr<const VolumeSnapshot> Gyroid(int size, std::uint64_t revision) {
  return MakeVolume(
      {size, size, size},
      [](int i, int j, int k) {
        constexpr double kTurn = 2.0 * M_PI / 24.0;
        return std::sin(kTurn * i) * std::cos(kTurn * j) +
               std::sin(kTurn * j) * std::cos(kTurn * k) +
               std::sin(kTurn * k) * std::cos(kTurn * i);
      },
      revision);
}

}  // namespace palpate::testing
