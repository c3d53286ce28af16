#include "client/web/volume/overview.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "client/web/volume/group.h"

namespace palpate::web {
namespace {

Vec3i CeilDiv(const Vec3i& size, int edge) { return (size + Vec3i::Constant(edge - 1)) / edge; }

std::size_t PlaceIn(const Vec3i& place, const Vec3i& size) {
  return (static_cast<std::size_t>(place.x()) * size.y() + place.y()) * size.z() + place.z();
}

// Calls visit(place) for all places from `begin` to before `end`, z fastest.
template <class Visit>
void ForEach(const Vec3i& begin, const Vec3i& end, Visit visit) {
  for (int i = begin.x(); i < end.x(); ++i) {
    for (int j = begin.y(); j < end.y(); ++j) {
      for (int k = begin.z(); k < end.z(); ++k) visit(Vec3i(i, j, k));
    }
  }
}

}  // namespace

Overview::Overview(const Vec3i& size, float background, int least_factor)
    : lattice_(size), factor_(least_factor) {
  while (CeilDiv(size, factor_).maxCoeff() > kMostBlocks) factor_ *= 2;
  cell_ = std::min(factor_, kGroupEdge);
  size_ = CeilDiv(size, factor_);
  cells_ = CeilDiv(size, cell_);
  sums_.resize(cells_.cast<std::size_t>().prod());
  ForEach(Vec3i::Zero(), CeilDiv(size, kGroupEdge),
          [&](const Vec3i& group) { PutConstantGroup(group, background); });
}

// sum(begin, end): of the voxels of the group from `begin` to before `end`.
template <class Sum>
void Overview::PutCells(const Vec3i& group, Sum sum) {
  const Vec3i first = group * kGroupEdge;
  const Vec3i end = (first + Vec3i::Constant(kGroupEdge)).cwiseMin(lattice_);
  ForEach(first / cell_, CeilDiv(end, cell_), [&](const Vec3i& cell) {
    const Vec3i cell_end = ((cell + Vec3i::Ones()) * cell_).cwiseMin(lattice_);
    sums_[PlaceIn(cell, cells_)] = sum(cell * cell_ - first, cell_end - first);
  });
  if (!bytes_.empty()) changed_.push_back(group);
}

void Overview::PutGroup(const Vec3i& group, LeafType type, std::string_view bytes) {
  VisitType(type, [&](auto voxel) {
    const auto* const voxels = reinterpret_cast<const decltype(voxel)*>(bytes.data());
    PutCells(group, [&](const Vec3i& begin, const Vec3i& end) {
      double sum = 0.0;
      ForEach(begin, end, [&](const Vec3i& v) {
        sum += static_cast<double>(voxels[v.x() * 1024 + v.y() * 32 + v.z()]);
      });
      return sum;
    });
  });
}

void Overview::PutConstantGroup(const Vec3i& group, float value) {
  PutCells(group, [&](const Vec3i& begin, const Vec3i& end) {
    return static_cast<double>(value) * (end - begin).prod();
  });
}

double Overview::Mean(const Vec3i& block) const {
  const Vec3i begin = block * factor_;
  const Vec3i end = (begin + Vec3i::Constant(factor_)).cwiseMin(lattice_);
  double sum = 0.0;
  ForEach(begin / cell_, CeilDiv(end, cell_),
          [&](const Vec3i& cell) { sum += sums_[PlaceIn(cell, cells_)]; });
  return sum / (end - begin).cast<double>().prod();
}

const std::string& Overview::Bytes(LeafType type) {
  if (bytes_.empty() || type != type_) {
    type_ = type;
    bytes_.assign(size_.cast<std::size_t>().prod() * VoxelBytes(type), '\0');
    Compute(Vec3i::Zero(), size_);
  } else {
    for (const Vec3i& group : changed_) {
      const Vec3i first = group * kGroupEdge;
      const Vec3i end = (first + Vec3i::Constant(kGroupEdge)).cwiseMin(lattice_);
      Compute(first / factor_, CeilDiv(end, factor_));
    }
  }
  changed_.clear();
  return bytes_;
}

// Blocks from `begin` to before `end`.
void Overview::Compute(const Vec3i& begin, const Vec3i& end) {
  VisitType(type_, [&](auto voxel) {
    using T = decltype(voxel);
    T* const to = reinterpret_cast<T*>(bytes_.data());
    ForEach(begin, end, [&](const Vec3i& block) {
      const double mean = Mean(block);
      to[PlaceIn(block, size_)] = static_cast<T>(std::is_integral_v<T> ? std::round(mean) : mean);
    });
  });
}

}  // namespace palpate::web
