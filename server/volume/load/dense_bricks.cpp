#include "server/volume/load/dense_bricks.h"

#include <openvdb/tree/LeafNode.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

namespace palpate {
namespace {

constexpr int kBlockEdge = 8 * kBrickEdge;

template <class T>
class DenseLeaves {
 public:
  DenseLeaves(const Vec3i& size, const ReadRows& read, T background)
      : size_(size), read_(read), background_(background) {}

  LeafPtr At(const Vec3i& brick) {
    const Vec3i corner = brick * kBrickEdge;
    const Vec3i strip = corner / kBlockEdge * kBlockEdge;
    if (strip.y() != strip_y_ || strip.z() != strip_z_) Read(strip.y(), strip.z());
    Gather(corner);
    const bool is_constant = std::all_of(values_.begin() + 1, values_.end(),
                                         [&](T value) { return Same(value, values_[0]); });
    return is_constant ? Constant(values_[0]) : Made();
  }

 private:
  // Compares bit by bit: -0 is not 0.
  static bool Same(T a, T b) { return std::memcmp(&a, &b, sizeof(T)) == 0; }

  // Reads the strip for a row of blocks along x.
  void Read(int first_y, int first_z) {
    strip_y_ = first_y;
    strip_z_ = first_z;
    strip_rows_ = std::min(kBlockEdge, size_.y() - first_y);
    const int layers = std::min(kBlockEdge, size_.z() - first_z);
    const auto layer_voxels = static_cast<std::size_t>(size_.x()) * strip_rows_;
    strip_.resize(layer_voxels * layers);
    for (int k = 0; k < layers; ++k) {
      read_(first_z + k, first_y, first_y + strip_rows_, strip_.data() + k * layer_voxels);
    }
  }

  void Gather(const Vec3i& corner) {
    // A copy, because the compiler takes any write of a byte for a write of the member, too.
    const T background = background_;
    const Vec3i end = (size_ - corner).cwiseMin(kBrickEdge);
    if (end != Vec3i::Constant(kBrickEdge)) values_.fill(background);
    for (int k = 0; k < end.z(); ++k) {
      for (int j = 0; j < end.y(); ++j) {
        const int layer = corner.z() + k - strip_z_, line = corner.y() + j - strip_y_;
        const T* const row = strip_.data() +
                             (static_cast<std::size_t>(layer) * strip_rows_ + line) * size_.x() +
                             corner.x();
        T* voxel = values_.data() + VoxelInBrick(0, j, k);
        for (int i = 0; i < end.x(); ++i, voxel += VoxelInBrick(1, 0, 0)) {
          // If the background is a zero, every zero gets the background's sign. Older versions read
          // volumes in this way, too.
          *voxel = row[i] == background ? background : row[i];
        }
      }
    }
  }

  // Makes one leaf per value; values count as equal only bit by bit.
  LeafPtr Constant(T value) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &value, sizeof(T));
    LeafPtr& leaf = constants_[bits];
    if (!leaf) leaf = Leaf::Constant(kLeafTypeOf<T>, static_cast<float>(value));
    return leaf;
  }

  LeafPtr Made() const {
    // Without PartialCreate, all voxels would be written twice.
    auto node = std::make_unique<Leaf::Node<T>>(openvdb::PartialCreate(), openvdb::Coord(0, 0, 0),
                                                background_, true);
    std::copy(values_.begin(), values_.end(), node->buffer().data());
    // A shortcut: most leaves have no voxel of the least value.
    if (std::find(values_.begin(), values_.end(), background_) == values_.end()) {
      return Leaf::Take(std::move(node));
    }
    for (int n = 0; n < kBrickVoxels; ++n) {
      const auto place = static_cast<openvdb::Index>(n);
      if (values_[place] == background_) node->setValueOff(place);
    }
    return Leaf::Take(std::move(node));
  }

  const Vec3i size_;
  const ReadRows& read_;
  const T background_;
  int strip_y_ = -1, strip_z_ = -1, strip_rows_ = 0;
  std::vector<T> strip_;
  std::array<T, kBrickVoxels> values_;
  std::unordered_map<std::uint32_t, LeafPtr> constants_;
};

}  // namespace

std::uint64_t StripBytes(const Vec3i& size_voxels, LeafType type) {
  const Vec3i strip(size_voxels.x(), std::min(kBlockEdge, size_voxels.y()),
                    std::min(kBlockEdge, size_voxels.z()));
  return static_cast<std::uint64_t>(strip.cast<std::int64_t>().prod()) * VoxelBytes(type);
}

BrickDirectory MakeBricks(const Vec3i& size_voxels, LeafType type, const ReadRows& read,
                          float background) {
  return VisitType(type, [&](auto voxel) -> BrickDirectory {
    using T = decltype(voxel);
    DenseLeaves<T> leaves(size_voxels, read, static_cast<T>(background));
    return {size_voxels, [&](const Vec3i& brick) { return leaves.At(brick); }};
  });
}

}  // namespace palpate
