#include "server/volume/edit/edit_region.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <type_traits>

#include "common/error/error.h"
#include "common/error/text.h"

namespace palpate {
namespace {

// Longer lengths are clamped to this, so that squares stay finite. No volume is as large.
constexpr double kFarthest = 1e30;

// Distance from a brick's first voxel to its middle, along an axis.
constexpr double kHalfBrick = 0.5 * (kBrickEdge - 1);

// Allowance for rounding of voxels on the boundary of the region.
constexpr double kSlackVoxels = 1e-6;

[[noreturn]] void RefuseSize(double voxels) {
  throw Error(ErrorKind::kTooLarge, fmt::format("the edit spans {:.0f} voxels, at most {} at once "
                                                "are possible: do it in parts, or by FilterVolume",
                                                voxels, kMostEditedVoxels));
}

// Checks the centre of a sphere, or an end of a capsule.
void CheckPoint(const Vec3& point) {
  if (!point.allFinite()) Refuse("the shape's position is not finite");
  if (point.cwiseAbs().maxCoeff() > kFarthest) {
    Refuse("the shape is outside of the volume: give a position near it");
  }
}

void CheckRadius(double radius) {
  if (!(radius > 0.0) || !std::isfinite(radius)) {
    Refuse(fmt::format("the radius {} is not a finite length above 0", radius));
  }
}

void CheckShape(const SphereShape& sphere) {
  CheckPoint(sphere.center);
  CheckRadius(sphere.radius);
}

void CheckShape(const BoxShape& box) {
  if (!box.min.allFinite() || !box.max.allFinite()) Refuse("the box is not finite");
  if ((box.min.array() > box.max.array()).any()) {
    Refuse("the box's min is above its max: exchange them");
  }
}

void CheckShape(const CapsuleShape& capsule) {
  CheckPoint(capsule.from);
  CheckPoint(capsule.to);
  CheckRadius(capsule.radius);
}

// Compares as float, the type of voxels. Also refuses NaN.
void CheckValue(const VolumeMetadata& metadata, double value) {
  const auto stored = static_cast<float>(value);
  const auto [least, greatest] = metadata.EditRange();
  if (stored >= static_cast<float>(least) && stored <= static_cast<float>(greatest)) return;
  Refuse(fmt::format("value {} is not within {} to {}{}", value, NumberText(least),
                     NumberText(greatest), metadata.unit.empty() ? "" : " " + metadata.unit));
}

void CheckBlock(const VolumeMetadata& metadata, const VolumeEdit& edit, const DenseBlock& block) {
  if (edit.frame != EditFrame::kIndex) Refuse("a block is given in voxels, not in mm");
  if (edit.operation == EditOperation::kSmooth) Refuse("a block has values: it cannot smooth");
  if (edit.falloff != 0.0) Refuse("a block has no falloff");
  const auto size = metadata.size.cast<std::int64_t>().eval();
  if ((block.min.array() < 0).any() || (block.size.array() < 1).any() ||
      (block.min.array() >= size.array()).any() ||
      (block.size.array() > (size - block.min).array()).any()) {
    Refuse(fmt::format("the block is not within the volume of {} x {} x {} voxels", size.x(),
                       size.y(), size.z()));
  }
  const double voxels = block.size.cast<double>().prod();
  if (voxels > static_cast<double>(kMostEditedVoxels)) RefuseSize(voxels);
  if (block.values.size() != static_cast<std::size_t>(block.size.prod())) {
    Refuse(fmt::format("the block of {} voxels has {} values", block.size.prod(),
                       block.values.size()));
  }
  for (const float value : block.values) {
    if (!std::isfinite(value)) Refuse("a value of the block is not finite");
  }
  if (edit.operation == EditOperation::kAdd || edit.operation == EditOperation::kSubtract) return;
  const auto [least, greatest] = std::minmax_element(block.values.begin(), block.values.end());
  CheckValue(metadata, *least);
  CheckValue(metadata, *greatest);
}

// The least and greatest coordinate of a shape along `row`, and half the width that a distance of 1
// adds to the shape. This half width is the row's length, because shapes grow equally in all
// directions.
struct Span {
  double low;
  double high;
  double radius;
};

Span SpanOf(const SphereShape& sphere, const Vec3& row) {
  const double center = row.dot(sphere.center);
  return {center, center, std::min(sphere.radius, kFarthest)};
}

Vec3 Cut(const Vec3& p) { return p.cwiseMax(-kFarthest).cwiseMin(kFarthest); }

Span SpanOf(const BoxShape& box, const Vec3& row) {
  const Vec3 a = row.cwiseProduct(Cut(box.min)), b = row.cwiseProduct(Cut(box.max));
  return {a.cwiseMin(b).sum(), a.cwiseMax(b).sum(), 0.0};
}

Span SpanOf(const CapsuleShape& capsule, const Vec3& row) {
  const double a = row.dot(capsule.from), b = row.dot(capsule.to);
  return {std::min(a, b), std::max(a, b), std::min(capsule.radius, kFarthest)};
}

// Returns a function for the distance of a position from a shape. The distance is negative inside,
// and never changes by more than the position moves.
auto DistanceTo(const SphereShape& sphere) {
  return [center = sphere.center, radius = std::min(sphere.radius, kFarthest)](const Vec3& p) {
    return (p - center).norm() - radius;
  };
}

auto DistanceTo(const BoxShape& box) {
  return [min = Cut(box.min), max = Cut(box.max)](const Vec3& p) {
    const Vec3 beyond = (min - p).cwiseMax(p - max);
    const double nearest = beyond.maxCoeff();
    return nearest <= 0.0 ? nearest : beyond.cwiseMax(0.0).norm();
  };
}

auto DistanceTo(const CapsuleShape& capsule) {
  const Vec3 way = capsule.to - capsule.from;
  const double length = way.norm();
  const Vec3 axis = length > 0.0 ? Vec3(way / length) : Vec3::Zero();
  const double radius = std::min(capsule.radius, kFarthest);
  return [from = capsule.from, length, axis, radius](const Vec3& p) {
    const Vec3 away = p - from;
    const double along = std::clamp(away.dot(axis), 0.0, length);
    return (away - along * axis).norm() - radius;
  };
}

AffineMap FrameFromIndex(const VolumeSnapshot& volume, EditFrame frame) {
  return frame == EditFrame::kWorld ? volume.metadata().WorldFromIndex() : AffineMap();
}

// Names what the volume spans, in the frame of the edit.
[[noreturn]] void RefuseRegion(const VolumeSnapshot& volume, EditFrame frame) {
  const AffineMap X_FI = FrameFromIndex(volume, frame);
  const Vec3 last_I = volume.size().cast<double>() - Vec3::Ones();
  Vec3 low = X_FI.translation, high = X_FI.translation;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 edge = X_FI.linear.col(axis) * last_I[axis];
    low += edge.cwiseMin(0.0);
    high += edge.cwiseMax(0.0);
  }
  Refuse(
      fmt::format("the edit's region is outside of the volume, which spans x {:.5g} to {:.5g}, "
                  "y {:.5g} to {:.5g}, z {:.5g} to {:.5g} {}",
                  low.x(), high.x(), low.y(), high.y(), low.z(), high.z(),
                  frame == EditFrame::kWorld ? "mm" : "voxels"));
}

template <class Shape>
std::optional<IndexBox> VoxelsOf(const VolumeSnapshot& volume, const VolumeEdit& edit,
                                 const Shape& shape, std::int64_t most_voxels) {
  const AffineMap X_IF = FrameFromIndex(volume, edit.frame).Inverse();
  IndexBox box;
  bool empty = false;
  double voxels = 1.0;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 row = X_IF.linear.row(axis);
    const Span span = SpanOf(shape, row);
    const double reach = row.norm() * (span.radius + std::min(edit.falloff, kFarthest));
    const double low = span.low - reach + X_IF.translation[axis];
    const double high = span.high + reach + X_IF.translation[axis];
    const double last = volume.size()[axis] - 1;
    if (!(high >= -0.5 && low <= last + 0.5)) RefuseRegion(volume, edit.frame);
    const double first_voxel = std::max(0.0, std::ceil(low - kSlackVoxels));
    const double last_voxel = std::min(last, std::floor(high + kSlackVoxels));
    if (first_voxel > last_voxel) {
      empty = true;
      continue;
    }
    box.min[axis] = static_cast<int>(first_voxel);
    box.max[axis] = static_cast<int>(last_voxel);
    voxels *= last_voxel - first_voxel + 1.0;
  }
  if (empty) return std::nullopt;
  if (voxels > static_cast<double>(most_voxels)) RefuseSize(voxels);
  return box;
}

}  // namespace

void CheckEdit(const VolumeSnapshot& volume, const VolumeEdit& edit) {
  if (!std::isfinite(edit.value)) Refuse("the value is not finite");
  if (!(edit.strength > 0.0 && edit.strength <= 1.0)) {
    Refuse(fmt::format("strength {} is not above 0 and at most 1", edit.strength));
  }
  if (!(edit.falloff >= 0.0) || !std::isfinite(edit.falloff)) {
    Refuse(fmt::format("the falloff {} is not a finite length of at least 0", edit.falloff));
  }
  if (const auto* block = std::get_if<DenseBlock>(&edit.shape)) {
    CheckBlock(volume.metadata(), edit, *block);
    return;
  }
  std::visit(
      [](const auto& shape) {
        if constexpr (!std::is_same_v<std::decay_t<decltype(shape)>, DenseBlock>) {
          CheckShape(shape);
        }
      },
      edit.shape);
  if (edit.operation == EditOperation::kSet || edit.operation == EditOperation::kPaint) {
    CheckValue(volume.metadata(), edit.value);
  }
}

std::optional<IndexBox> EditedVoxels(const VolumeSnapshot& volume, const VolumeEdit& edit,
                                     std::int64_t most_voxels) {
  return std::visit(
      [&](const auto& shape) -> std::optional<IndexBox> {
        if constexpr (std::is_same_v<std::decay_t<decltype(shape)>, DenseBlock>) {
          return IndexBox{shape.min.template cast<int>(),
                          (shape.min + shape.size).template cast<int>() - Vec3i::Ones()};
        } else {
          return VoxelsOf(volume, edit, shape, most_voxels);
        }
      },
      edit.shape);
}

EditWeights::EditWeights(const VolumeSnapshot& volume, const VolumeEdit& edit)
    : edit_(edit), X_FI_(FrameFromIndex(volume, edit.frame)) {
  double farthest = 0.0;
  for (int corner = 0; corner < 4; ++corner) {
    const Vec3 half(corner & 1 ? kHalfBrick : -kHalfBrick, corner & 2 ? kHalfBrick : -kHalfBrick,
                    kHalfBrick);
    farthest = std::max(farthest, (X_FI_.linear * half).norm());
  }
  // Slightly too large: if rounding could decide, each voxel is checked by itself.
  brick_radius_ = farthest * (1.0 + 1e-6);
}

double EditWeights::OfDistance(double distance) const {
  if (distance <= 0.0) return 1.0;
  if (distance >= edit_.falloff) return 0.0;
  const double share = 1.0 - distance / edit_.falloff;
  return share * share * (3.0 - 2.0 * share);
}

template <class Distance>
bool EditWeights::Fill(const Vec3i& brick, const Distance& distance, BrickNumbers& weights) const {
  const Vec3 corner = X_FI_.Apply((brick * kBrickEdge).cast<double>());
  const Vec3 middle = corner + X_FI_.linear * Vec3::Constant(kHalfBrick);
  // No voxel is farther from the middle than brick_radius_, so its distance from the shape differs
  // by at most brick_radius_.
  const double from_middle = distance(middle);
  if (from_middle - brick_radius_ > edit_.falloff) return false;
  if (from_middle + brick_radius_ <= 0.0) {
    weights.fill(1.0);
    return true;
  }
  for (int i = 0; i < kBrickEdge; ++i) {
    for (int j = 0; j < kBrickEdge; ++j) {
      const Vec3 row = corner + X_FI_.linear * Vec3(i, j, 0);
      for (int k = 0; k < kBrickEdge; ++k) {
        weights[VoxelInBrick(i, j, k)] = OfDistance(distance(row + k * X_FI_.linear.col(2)));
      }
    }
  }
  return true;
}

bool EditWeights::Of(const Vec3i& brick, BrickNumbers& weights) const {
  return std::visit(
      [&](const auto& shape) {
        if constexpr (std::is_same_v<std::decay_t<decltype(shape)>, DenseBlock>) {
          weights.fill(1.0);
          return true;
        } else {
          return Fill(brick, DistanceTo(shape), weights);
        }
      },
      edit_.shape);
}

}  // namespace palpate
