#include "client/view/volume/brick_parts.h"

#include <algorithm>
#include <cstdlib>

namespace palpate::view {
namespace {

const Vec3i kWhole = Vec3i::Constant(kBrickEdge);

template <class T>
ValueRange RangeOfAll(const T* values) {
  if constexpr (std::is_same_v<T, float>) {
    const Eigen::Map<const Eigen::Array<float, kBrickVoxels, 1>> all(values);
    return {all.minCoeff(), all.maxCoeff()};
  } else {
    T least = values[0];
    T most = values[0];
    for (int n = 0; n < kBrickVoxels; ++n) {
      least = std::min(least, values[n]);
      most = std::max(most, values[n]);
    }
    return {static_cast<float>(least), static_cast<float>(most)};
  }
}

template <class T>
ValueRange RangeOf(const T* values, const Vec3i& first, const Vec3i& end) {
  T least = values[VoxelInBrick(first.x(), first.y(), first.z())];
  T most = least;
  for (int i = first.x(); i < end.x(); ++i) {
    for (int j = first.y(); j < end.y(); ++j) {
      const T* const row = values + VoxelInBrick(i, j, 0);
      for (int k = first.z(); k < end.z(); ++k) {
        least = row[k] < least ? row[k] : least;
        most = row[k] > most ? row[k] : most;
      }
    }
  }
  return {static_cast<float>(least), static_cast<float>(most)};
}

}  // namespace

ValueRange RangeOfPart(const TypedBrick& brick, const Vec3i& first, const Vec3i& end) {
  if (brick.is_constant()) return {brick[0], brick[0]};
  return VisitType(brick.type(), [&](auto voxel) {
    const auto* const values = brick.values<decltype(voxel)>();
    return first == Vec3i::Zero() && end == kWhole ? RangeOfAll(values)
                                                   : RangeOf(values, first, end);
  });
}

VoxelCounts::~VoxelCounts() {
  for (std::size_t n = 0; n < counts_.size(); ++n) {
    if (counts_[n] == 0) continue;
    const auto value = static_cast<float>(static_cast<int>(n) + kLeast);
    const auto times = static_cast<std::uint64_t>(std::abs(counts_[n]));
    counts_[n] > 0 ? histogram_.Add(value, times) : histogram_.Remove(value, times);
  }
}

template <int kSign>
void VoxelCounts::Count(const TypedBrick& brick, const Vec3i& end) {
  if (brick.is_constant()) {
    const auto times = static_cast<std::uint64_t>(end.prod());
    kSign > 0 ? histogram_.Add(brick[0], times) : histogram_.Remove(brick[0], times);
    return;
  }
  VisitType(brick.type(), [&](auto voxel) {
    using T = decltype(voxel);
    const T* const values = brick.values<T>();
    const auto count = [&](const T* row, int length) {
      if constexpr (std::is_same_v<T, float>) {
        const std::span span(row, static_cast<std::size_t>(length));
        kSign > 0 ? histogram_.Add(span) : histogram_.Remove(span);
      } else {
        if (counts_.empty()) counts_.resize((1 << 16) - kLeast);
        std::int64_t* const from_zero = counts_.data() - kLeast;
        for (int k = 0; k < length; ++k) from_zero[row[k]] += kSign;
      }
    };
    if (end == kWhole) {
      count(values, kBrickVoxels);
      return;
    }
    for (int i = 0; i < end.x(); ++i) {
      for (int j = 0; j < end.y(); ++j) count(values + VoxelInBrick(i, j, 0), end.z());
    }
  });
}

template void VoxelCounts::Count<1>(const TypedBrick&, const Vec3i&);
template void VoxelCounts::Count<-1>(const TypedBrick&, const Vec3i&);

}  // namespace palpate::view
