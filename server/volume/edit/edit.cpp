#include "server/volume/edit/edit.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>

#include "server/volume/edit/edit_region.h"

namespace palpate {
namespace {

// Counts changed voxels, brick by brick. A mask holds one bit for each place along an axis of a
// brick.
class ChangeCounter {
 public:
  struct Masks {
    unsigned i = 0, j = 0, k = 0;
    std::uint64_t voxels = 0;
  };

  void Add(const Vec3i& brick, const Masks& masks) {
    if (masks.voxels == 0) return;
    const auto first = [](unsigned mask) { return std::countr_zero(mask); };
    const auto last = [](unsigned mask) { return std::bit_width(mask) - 1; };
    const Vec3i corner = brick * kBrickEdge;
    low_ = low_.cwiseMin(corner + Vec3i(first(masks.i), first(masks.j), first(masks.k)));
    high_ = high_.cwiseMax(corner + Vec3i(static_cast<int>(last(masks.i)),
                                          static_cast<int>(last(masks.j)),
                                          static_cast<int>(last(masks.k))));
    voxels_ += masks.voxels;
  }
  void Into(EditResult& result) const {
    result.changed_voxels = voxels_;
    if (voxels_ > 0) result.changed = IndexBox{low_, high_};
  }

 private:
  Vec3i low_ = Vec3i::Constant(std::numeric_limits<int>::max());
  Vec3i high_ = Vec3i::Constant(-1);
  std::uint64_t voxels_ = 0;
};

// Writes `value(n)` to `brick` for the voxels of `part`; n is the place in the brick. Returns which
// of them have changed.
template <class Value>
ChangeCounter::Masks Replace(Brick& brick, const IndexBox& part, const Value& value) {
  ChangeCounter::Masks masks;
  for (int i = part.min.x(); i <= part.max.x(); ++i) {
    for (int j = part.min.y(); j <= part.max.y(); ++j) {
      unsigned row = 0;
      for (int k = part.min.z(); k <= part.max.z(); ++k) {
        const std::size_t n = VoxelInBrick(i, j, k);
        const float was = brick[n];
        const float is = value(n);
        row |= static_cast<unsigned>(is != was) << k;
        brick[n] = is != was ? is : was;
      }
      if (row == 0) continue;
      masks.i |= 1u << i;
      masks.j |= 1u << j;
      masks.k |= row;
      masks.voxels += static_cast<unsigned>(std::popcount(row));
    }
  }
  return masks;
}

// Means of the 27 voxels around each voxel of a brick. Sums along one axis after the other, in
// doubles, so that the mean of equal values is exactly this value.
class BrickMeans {
 public:
  BrickMeans(const VolumeSnapshot& volume, const Vec3i& brick) {
    const Vec3i corner = brick * kBrickEdge - Vec3i::Ones();
    for (int axis = 0; axis < 3; ++axis) {
      for (int n = 0; n < kEdge; ++n) {
        const int voxel = corner[axis] + n;
        inside_[axis][n] = voxel >= 0 && voxel < volume.size()[axis];
      }
    }
    Fetch(volume, corner);
    SumAlongAxes();
  }

  double At(int i, int j, int k) const {
    return sums_[Place(i, j, k)] / (CountAt(0, i) * CountAt(1, j) * CountAt(2, k));
  }

 private:
  static constexpr int kEdge = kBrickEdge + 2;
  static constexpr int kStrideI = kEdge * kEdge;
  static constexpr int Place(int i, int j, int k) { return (i * kEdge + j) * kEdge + k; }

  // Voxels beyond the lattice add nothing.
  void Fetch(const VolumeSnapshot& volume, const Vec3i& corner) {
    for (int i = 0; i < kEdge; ++i) {
      for (int j = 0; j < kEdge; ++j) {
        for (int k = 0; k < kEdge; ++k) {
          const int x = corner.x() + i, y = corner.y() + j, z = corner.z() + k;
          sums_[Place(i, j, k)] = inside_[0][i] && inside_[1][j] && inside_[2][k]
                                      ? volume.bricks().Find(x, y, z)[VoxelInBrick(x, y, z)]
                                      : 0.0;
        }
      }
    }
  }

  // Afterwards, place (i, j, k) holds the sum around voxel (i, j, k) of the brick. Works in place:
  // each sum needs only places that are not overwritten yet.
  void SumAlongAxes() {
    for (const int stride : {1, kEdge, kStrideI}) {
      for (int n = 0; n + 2 * stride < kEdge * kStrideI; ++n) {
        sums_[n] += sums_[n + stride] + sums_[n + 2 * stride];
      }
    }
  }

  int CountAt(int axis, int n) const {
    return inside_[axis][n] + inside_[axis][n + 1] + inside_[axis][n + 2];
  }

  std::array<std::array<bool, kEdge>, 3> inside_;
  std::array<double, kEdge * kStrideI> sums_;
};

// The part of a brick that lies in the edited box, in voxels of the brick.
IndexBox PartOf(const Vec3i& brick, const IndexBox& box) {
  const Vec3i corner = brick * kBrickEdge;
  return {(box.min - corner).cwiseMax(0),
          (box.max - corner).cwiseMin(Vec3i::Constant(kBrickEdge - 1))};
}

template <class Visit>
void ForEach(const IndexBox& box, const Visit& visit) {
  for (int i = box.min.x(); i <= box.max.x(); ++i) {
    for (int j = box.min.y(); j <= box.max.y(); ++j) {
      for (int k = box.min.z(); k <= box.max.z(); ++k) visit(i, j, k);
    }
  }
}

class Editor {
 public:
  // `before`: of a stroke that acts once; null: the edit acts on the present values.
  Editor(const VolumeSnapshot& volume, const VolumeEdit& edit, const VolumeSnapshot* before)
      : volume_(volume), edit_(edit), before_(before) {
    const VolumeMetadata& metadata = volume.metadata();
    const auto [least, greatest] =
        before ? std::pair(metadata.value_min, metadata.value_max) : metadata.EditRange();
    least_ = static_cast<float>(least);
    greatest_ = static_cast<float>(greatest);
    targets_.fill(edit.value);
  }

  EditResult Run(const IndexBox& box, const EditCalls& calls) {
    EditResult result;
    ChangeCounter counter;
    const IndexBox bricks{box.min / kBrickEdge, box.max / kBrickEdge};
    int layer = bricks.min.x();
    ForEach(bricks, [&](int a, int b, int c) {
      if (calls.progress && a > layer) {
        layer = a;
        calls.progress(static_cast<double>(a - bricks.min.x()) /
                       (bricks.max.x() - bricks.min.x() + 1));
      }
      const Vec3i brick(a, b, c);
      if (!weights_of_.Of(brick, weights_)) return;
      const IndexBox part = PartOf(brick, box);
      FillTargets(brick, part);
      const LeafPtr& before = volume_.bricks().At(brick);
      before->CopyTo(after_.data());
      if (before_) before_->bricks().At(brick)->CopyTo(from_.data());
      const ChangeCounter::Masks masks = Operate(part);
      counter.Add(brick, masks);
      if (masks.voxels > 0) {
        result.changes.push_back({brick, before->With(after_)});
      }
    });
    counter.Into(result);
    return result;
  }

 private:
  // Fills in the value towards which each voxel changes, if it is not the edit's value.
  void FillTargets(const Vec3i& brick, const IndexBox& part) {
    if (const auto* block = std::get_if<DenseBlock>(&edit_.shape)) {
      const Vec3i from_block = brick * kBrickEdge - block->min.cast<int>();
      ForEach(part, [&](int i, int j, int k) {
        const auto place = (from_block + Vec3i(i, j, k)).cast<std::int64_t>().eval();
        const auto n = static_cast<std::size_t>(
            (place.z() * block->size.y() + place.y()) * block->size.x() + place.x());
        targets_[VoxelInBrick(i, j, k)] = block->values[n];
      });
    } else if (edit_.operation == EditOperation::kSmooth) {
      const BrickMeans means(before_ ? *before_ : volume_, brick);
      ForEach(part,
              [&](int i, int j, int k) { targets_[VoxelInBrick(i, j, k)] = means.At(i, j, k); });
    }
  }

  ChangeCounter::Masks Operate(const IndexBox& part) {
    // Chooses the operation outside the loop over voxels.
    const auto with = [&](const auto& result) {
      return Replace(after_, part, [&](std::size_t n) {
        const double weight = weights_[n];
        if (weight == 0.0) return after_[n];
        const auto present = static_cast<double>(after_[n]);
        const double from = before_ ? static_cast<double>(from_[n]) : present;
        const double value = result(from, weight, targets_[n]);
        if (before_ && std::abs(value - from) <= std::abs(present - from)) return after_[n];
        const double within =
            before_ ? std::clamp(value, std::min(from, least_), std::max(from, greatest_))
                    : std::clamp(value, least_, greatest_);
        // Adding 0 removes the sign of a zero: files do not keep it.
        return static_cast<float>(within) + 0.0f;
      });
    };
    // Returns the target exactly at a share of 1, so that rounding leaves nothing of the old value.
    const auto toward = [](double voxel, double share, double target) {
      return share == 1.0 ? target : voxel + share * (target - voxel);
    };
    switch (edit_.operation) {
      case EditOperation::kAdd:
        return with([](double voxel, double w, double target) { return voxel + w * target; });
      case EditOperation::kSubtract:
        return with([](double voxel, double w, double target) { return voxel - w * target; });
      case EditOperation::kSet:
        return with(toward);
      case EditOperation::kUnknown:
      case EditOperation::kSmooth:
      case EditOperation::kPaint:
        break;
    }
    return with([&](double voxel, double w, double target) {
      return toward(voxel, w * edit_.strength, target);
    });
  }

  const VolumeSnapshot& volume_;
  const VolumeEdit& edit_;
  const VolumeSnapshot* const before_;
  const EditWeights weights_of_{volume_, edit_};
  double least_ = 0.0;
  double greatest_ = 0.0;
  BrickNumbers weights_;
  BrickNumbers targets_;
  Brick after_;
  Brick from_;  // of before_
};

EditResult Run(const VolumeSnapshot& volume, const VolumeEdit& edit, const EditCalls& calls,
               const VolumeSnapshot* before) {
  CheckEdit(volume, edit);
  const std::int64_t most =
      calls.progress ? std::numeric_limits<std::int64_t>::max() : kMostEditedVoxels;
  const std::optional<IndexBox> box = EditedVoxels(volume, edit, most);
  if (!box) return {};
  if (calls.box_known) calls.box_known(*box);
  return Editor(volume, edit, before).Run(*box, calls);
}

}  // namespace

EditResult ApplyEdit(const VolumeSnapshot& volume, const VolumeEdit& edit, const EditCalls& calls) {
  return Run(volume, edit, calls, nullptr);
}

EditResult ApplyEditOnce(const VolumeSnapshot& before, const VolumeSnapshot& volume,
                         const VolumeEdit& edit, const EditCalls& calls) {
  return Run(volume, edit, calls, &before);
}

std::uint64_t MostBrickBytes(const IndexBox& box) {
  const Vec3i min = box.min / kBrickEdge, max = box.max / kBrickEdge;
  const Vec3i count = max - min + Vec3i::Ones();
  return static_cast<std::uint64_t>(count.cast<std::int64_t>().prod()) *
             Leaf::Bytes(LeafType::kFloat) +
         BrickDirectory::BlockBytes(min, max);
}

EditResult CompareBricks(const VolumeSnapshot& volume, const std::vector<BrickChange>& changes) {
  EditResult result;
  ChangeCounter counter;
  const IndexBox whole{Vec3i::Zero(), Vec3i::Constant(kBrickEdge - 1)};
  for (const BrickChange& change : changes) {
    const LeafPtr& before = volume.bricks().At(change.brick);
    if (before == change.values) continue;
    Brick brick = before->Floats();
    const Brick after = change.values->Floats();
    const auto masks = Replace(brick, whole, [&](std::size_t n) { return after[n]; });
    if (masks.voxels == 0) continue;
    counter.Add(change.brick, masks);
    result.changes.push_back(change);
  }
  counter.Into(result);
  return result;
}

}  // namespace palpate
