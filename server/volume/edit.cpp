#include "server/volume/edit.h"

#include <algorithm>
#include <array>
#include <limits>
#include <memory>

#include "server/volume/edit_region.h"

namespace palpate {
namespace {

// Sets `changed` and the count.
class ChangeCounter {
 public:
  void Add(const Vec3i& voxel) {
    low_ = low_.cwiseMin(voxel);
    high_ = high_.cwiseMax(voxel);
    ++voxels_;
  }
  void Into(EditResult& result) const {
    result.changed_voxels = voxels_;
    if (voxels_ > 0) result.changed = VoxelBox{low_, high_};
  }

 private:
  Vec3i low_ = Vec3i::Constant(std::numeric_limits<int>::max());
  Vec3i high_ = Vec3i::Constant(-1);
  std::uint64_t voxels_ = 0;
};

// Means of the 27 voxels around each voxel of a brick. Sums along one axis after
// the other; within doubles, so that equal values have exactly their own mean.
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

  // What lies beyond the lattice adds nothing.
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

  // Ends with the sum around voxel (i, j, k) of the brick at place (i, j, k). In
  // place: each sum needs only places that are not overwritten yet.
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
VoxelBox PartOf(const Vec3i& brick, const VoxelBox& box) {
  const Vec3i corner = brick * kBrickEdge;
  return {(box.min - corner).cwiseMax(0),
          (box.max - corner).cwiseMin(Vec3i::Constant(kBrickEdge - 1))};
}

template <class Visit>
void ForEach(const VoxelBox& box, const Visit& visit) {
  for (int i = box.min.x(); i <= box.max.x(); ++i) {
    for (int j = box.min.y(); j <= box.max.y(); ++j) {
      for (int k = box.min.z(); k <= box.max.z(); ++k) visit(i, j, k);
    }
  }
}

class Editor {
 public:
  Editor(const VolumeSnapshot& volume, const VolumeEdit& edit)
      : volume_(volume),
        edit_(edit),
        least_(static_cast<float>(volume.metadata().value_min)),
        greatest_(static_cast<float>(volume.metadata().value_max)) {}

  EditResult Run(const VoxelBox& box) {
    EditResult result;
    const VoxelBox bricks{box.min / kBrickEdge, box.max / kBrickEdge};
    ForEach(bricks, [&](int a, int b, int c) {
      const Vec3i brick(a, b, c);
      const VoxelBox part = PartOf(brick, box);
      const Brick& before = *volume_.bricks().At(brick);
      after_ = before;
      const std::uint64_t count = std::holds_alternative<DenseBlock>(edit_.shape)
                                      ? ByBlock(brick, part)
                                      : ByShape(brick, part);
      if (count > 0) result.changes.push_back({brick, std::make_shared<const Brick>(after_)});
    });
    counter_.Into(result);
    return result;
  }

 private:
  std::uint64_t ByBlock(const Vec3i& brick, const VoxelBox& part) {
    const auto& block = std::get<DenseBlock>(edit_.shape);
    const Vec3i corner = brick * kBrickEdge;
    const Vec3i from_block = corner - block.min.cast<int>();
    std::uint64_t count = 0;
    ForEach(part, [&](int i, int j, int k) {
      const Vec3i place = from_block + Vec3i(i, j, k);
      const auto n = static_cast<std::size_t>(
          (place.z() * block.size.y() + place.y()) * block.size.x() + place.x());
      count += Store(corner, i, j, k, 1.0, block.values[n]);
    });
    return count;
  }

  std::uint64_t ByShape(const Vec3i& brick, const VoxelBox& part) {
    const EditWeights::Reach reach = weights_.Of(brick);
    if (reach == EditWeights::Reach::kNone) return 0;
    const Vec3i corner = brick * kBrickEdge;
    std::optional<BrickMeans> means;
    if (edit_.operation == EditOperation::kSmooth) means.emplace(volume_, brick);
    std::uint64_t count = 0;
    ForEach(part, [&](int i, int j, int k) {
      const double weight = reach == EditWeights::Reach::kAll
                                ? 1.0
                                : weights_.At((corner + Vec3i(i, j, k)).cast<double>());
      if (weight == 0.0) return;
      count += Store(corner, i, j, k, weight, means ? means->At(i, j, k) : edit_.value);
    });
    return count;
  }

  // One voxel of after_. True where its value changed.
  bool Store(const Vec3i& corner, int i, int j, int k, double weight, double value) {
    float& voxel = after_[VoxelInBrick(i, j, k)];
    const double result = std::clamp(Result(voxel, weight, value), least_, greatest_);
    // A zero without sign: files do not keep it.
    const float stored = static_cast<float>(result) + 0.0f;
    if (stored == voxel) return false;
    voxel = stored;
    counter_.Add(corner + Vec3i(i, j, k));
    return true;
  }

  double Result(double voxel, double weight, double value) const {
    switch (edit_.operation) {
      case EditOperation::kAdd:
        return voxel + weight * value;
      case EditOperation::kSubtract:
        return voxel - weight * value;
      case EditOperation::kSet:
        break;
      case EditOperation::kSmooth:
      case EditOperation::kPaint:
        weight *= edit_.strength;
        break;
    }
    // So that nothing of the old value is left by rounding.
    return weight == 1.0 ? value : voxel + weight * (value - voxel);
  }

  const VolumeSnapshot& volume_;
  const VolumeEdit& edit_;
  const EditWeights weights_{volume_, edit_};
  const double least_;
  const double greatest_;
  Brick after_;
  ChangeCounter counter_;
};

}  // namespace

EditResult ApplyEdit(const VolumeSnapshot& volume, const VolumeEdit& edit) {
  CheckEdit(volume, edit);
  const std::optional<VoxelBox> box = EditedVoxels(volume, edit);
  return box ? Editor(volume, edit).Run(*box) : EditResult();
}

EditResult CompareBricks(const VolumeSnapshot& volume, const std::vector<BrickChange>& changes) {
  EditResult result;
  ChangeCounter counter;
  const VoxelBox whole{Vec3i::Zero(), Vec3i::Constant(kBrickEdge - 1)};
  for (const BrickChange& change : changes) {
    const Brick& before = *volume.bricks().At(change.brick);
    if (&before == change.values.get() || before == *change.values) continue;
    result.changes.push_back(change);
    ForEach(whole, [&](int i, int j, int k) {
      const std::size_t n = VoxelInBrick(i, j, k);
      if (before[n] != (*change.values)[n]) {
        counter.Add(change.brick * kBrickEdge + Vec3i(i, j, k));
      }
    });
  }
  counter.Into(result);
  return result;
}

}  // namespace palpate
