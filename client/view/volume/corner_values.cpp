#include "client/view/volume/corner_values.h"

#include <algorithm>
#include <cstdint>
#include <type_traits>

namespace palpate::view {
namespace {

template <class T>
bool Store(float value, T* to, std::ptrdiff_t count) {
  if (!Holds(kLeafTypeOf<T>, value)) return false;
  std::fill_n(to, count, static_cast<T>(value));
  return true;
}

// Copies a row of voxels.
template <class T, class U>
bool StoreRow(const U* from, T* to, int count) {
  constexpr bool kFits = std::is_same_v<T, U> || std::is_same_v<T, float> ||
                         (std::is_same_v<U, std::uint8_t> && sizeof(T) > 1);
  if constexpr (kFits) {
    std::copy_n(from, count, to);
    return true;
  }
  for (int k = 0; k < count; ++k) {
    if (!Store(static_cast<float>(from[k]), to + k, 1)) return false;
  }
  return true;
}

// A part of a target: `count` corners along each axis.
template <class T>
struct Part {
  CornerTarget<T> to;
  Vec3i count;

  template <class Row>
  bool ForEachRow(const Row& store) const {
    for (int i = 0; i < count.x(); ++i) {
      for (int j = 0; j < count.y(); ++j) {
        if (!store(i, j, to.first + i * to.image + j * to.row)) return false;
      }
    }
    return true;
  }
  bool Fill(float value) const {
    return ForEachRow([&](int, int, T* row) { return Store(value, row, count.z()); });
  }
  // The voxels of a brick from `first` on; `background` beyond `extent`.
  bool Copy(const TypedBrick& brick, const Vec3i& first, const Vec3i& extent,
            float background) const {
    if (extent != Vec3i::Constant(kBrickEdge) && !Fill(background)) return false;
    const Vec3i within = count.cwiseMin(extent - first);
    const Part part{to, within};
    if (brick.is_constant()) return part.Fill(brick[0]);
    return VisitType(brick.type(), [&](auto voxel) {
      const auto* const values = brick.values<decltype(voxel)>();
      return part.ForEachRow([&](int i, int j, T* row) {
        return StoreRow(values + VoxelInBrick(first.x() + i, first.y() + j, first.z()), row,
                        within.z());
      });
    });
  }
};

}  // namespace

template <class T>
bool CornerTarget<T>::Copy(const ViewVolume& volume, const Vec3i& cell_brick) const {
  const VolumeLattice& lattice = *volume.lattice();
  const Vec3i counts = lattice.BrickCounts();
  for (int n = 0; n < 8; ++n) {
    // The first corner along an axis is the last voxel of the brick before.
    const Vec3i before(n >> 2, n >> 1 & 1, n & 1);
    const Vec3i after = Vec3i::Ones() - before;
    T* const begin = first + after.x() * image + after.y() * row + after.z();
    const Part<T> part{{begin, row, image}, Vec3i::Ones() + after * (kBrickEdge - 1)};
    const Vec3i brick = cell_brick - before;
    const bool is_within = (brick.array() >= 0).all() && (brick.array() < counts.array()).all();
    const Vec3i extent = (lattice.size - brick * kBrickEdge).cwiseMin(kBrickEdge);
    const bool fits = is_within ? part.Copy(*volume.bricks().At(brick), before * (kBrickEdge - 1),
                                            extent, lattice.Background())
                                : part.Fill(lattice.Background());
    if (!fits) return false;
  }
  return true;
}

template <class T>
bool CornerTarget<T>::CopyCoarse(const ViewVolume& volume, const Vec3i& block) const {
  const Part<T> part{*this, Vec3i::Constant(kCornerEdge)};
  const Vec3i voxel = block * kBrickEdge * kBrickEdge - Vec3i::Ones();
  return part.ForEachRow([&](int i, int j, T* to) {
    for (int k = 0; k < kCornerEdge; ++k) {
      if (!Store(volume.Value(voxel + Vec3i(i, j, k) * kBrickEdge), to + k, 1)) return false;
    }
    return true;
  });
}

template struct CornerTarget<std::uint8_t>;
template struct CornerTarget<std::int16_t>;
template struct CornerTarget<std::uint16_t>;
template struct CornerTarget<float>;

}  // namespace palpate::view
