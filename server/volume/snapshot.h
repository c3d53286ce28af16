// An immutable state of the volume, as the servo thread and viewers read it.
//
// Lattice vertices have index coordinates (i, j, k) in [0, size). A directory
// of leaf buffers, one pointer per 8³ block of OpenVDB's tree, serves the
// densities; the tree itself is never read here. One virtual layer of the
// background density (the range's minimum) surrounds the lattice, so that H is
// closed: cells -1 .. size-1 along each axis exist, beyond them all is free.
// Densities are normalised over the range of the metadata.
//
// Threads: any, at once. Real-time: every const method is wait-free and does
// not allocate. Ownership: shared; the leaf buffers live as long as the
// snapshot does.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "common/isosurface/cell.h"
#include "common/isosurface/ties.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

class VolumeSnapshot {
 public:
  static constexpr int kBrickEdge = 8;
  static constexpr int kBrickVoxels = kBrickEdge * kBrickEdge * kBrickEdge;

  // Brick (a, b, c) is bricks[(a * nb + b) * nc + c]; within it, voxel (i, j, k)
  // is at 64 i + 8 j + k. `owner` keeps the buffers alive.
  VolumeSnapshot(VolumeMetadata metadata, std::vector<const float*> bricks,
                 std::shared_ptr<const void> owner, std::uint64_t revision,
                 std::uint64_t memory_bytes);

  const VolumeMetadata& metadata() const { return metadata_; }
  std::uint64_t revision() const { return revision_; }
  std::uint64_t memory_bytes() const { return memory_bytes_; }
  const Vec3i& size() const { return metadata_.size; }

  // Data units to density and back.
  double Normalize(double value) const { return (value - metadata_.value_min) * inverse_range_; }
  double Denormalize(double density) const {
    return metadata_.value_min + density * (metadata_.value_max - metadata_.value_min);
  }

  // Densities of cell (i, j, k) as stored: what V is made of.
  CellDensities StoredCell(const Vec3i& cell) const noexcept;
  // The same with ties resolved: what H is made of.
  CellDensities ResolvedCell(const Vec3i& cell) const noexcept {
    return WithTiesResolved(StoredCell(cell), cell);
  }
  static CellDensities WithTiesResolved(const CellDensities& stored, const Vec3i& cell) noexcept;
  // Density of a lattice vertex, as stored and with ties resolved; the background
  // outside.
  double StoredVertex(const Vec3i& vertex) const noexcept;
  double ResolvedVertex(const Vec3i& vertex) const noexcept {
    return ResolvedDensity(StoredVertex(vertex), vertex.x(), vertex.y(), vertex.z());
  }

  // The cell is within the padded lattice; all other cells are free space.
  bool HasCell(const Vec3i& cell) const noexcept {
    return (cell.array() >= -1).all() && (cell.array() < metadata_.size.array()).all();
  }

 private:
  const float* Brick(int i, int j, int k) const noexcept {
    return bricks_[(static_cast<std::size_t>(i >> 3) * brick_count_y_ + (j >> 3)) * brick_count_z_ +
                   (k >> 3)];
  }

  VolumeMetadata metadata_;
  double inverse_range_;
  int brick_count_y_;
  int brick_count_z_;
  std::vector<const float*> bricks_;
  std::shared_ptr<const void> owner_;
  std::uint64_t revision_;
  std::uint64_t memory_bytes_;
};

// Bricks along an axis of `size` voxels.
constexpr int BrickCount(int size) {
  return (size + VolumeSnapshot::kBrickEdge - 1) / VolumeSnapshot::kBrickEdge;
}

}  // namespace palpate
