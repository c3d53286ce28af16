// An immutable state of the volume, for the servo thread and viewers.
//
// Lattice vertices have index coordinates (i, j, k) in [0, size). One virtual layer of the
// background density (0; for a level set: above 1) surrounds the lattice, so that H is closed.
// Cells -1 .. size-1 exist along each axis; everything beyond them is free. Densities are
// normalised over the range of the metadata.
//
// Threads: any, at once. Real-time: functions that read vertices and cells are wait-free and do not
// allocate. Ownership: shared; the bricks live as long as the snapshot.
#pragma once

#include <cstdint>

#include "common/isosurface/cell.h"
#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

class VolumeSnapshot {
 public:
  // loaded_revision: the revision at which this volume was loaded. Snapshots between it and
  // `revision` were the volume's edits and frames.
  VolumeSnapshot(VolumeMetadata metadata, BrickDirectory bricks, std::uint64_t revision,
                 std::uint64_t loaded_revision);

  const VolumeMetadata& metadata() const { return metadata_; }
  std::uint64_t revision() const { return revision_; }
  std::uint64_t loaded_revision() const { return loaded_revision_; }
  const BrickDirectory& bricks() const { return bricks_; }
  const Vec3i& size() const { return metadata_.size; }

  // Data units to density and back.
  double Normalize(double value) const { return (value - metadata_.value_min) * inverse_range_; }
  double Denormalize(double density) const {
    return metadata_.value_min + density * (metadata_.value_max - metadata_.value_min);
  }

  // Density beyond the lattice: 0, or more than any isovalue, however ties are resolved.
  double BackgroundDensity() const noexcept {
    return metadata_.is_level_set ? kAboveAllIsovalues : 0.0;
  }

  // Densities of cell (i, j, k) as stored. They define V.
  CellDensities StoredCell(const Vec3i& cell) const noexcept;
  // Densities of the cell with ties resolved. They define H.
  CellDensities ResolvedCell(const Vec3i& cell) const noexcept {
    return WithTiesResolved(StoredCell(cell), cell);
  }
  static CellDensities WithTiesResolved(const CellDensities& stored, const Vec3i& cell) noexcept {
    CellDensities d;
    for (int v = 0; v < 8; ++v) {
      const auto& o = kCornerOffset[v];
      d[v] = ResolvedDensity(stored[v], cell.x() + o[0], cell.y() + o[1], cell.z() + o[2]);
    }
    return d;
  }
  // Density of a lattice vertex, as stored and with ties resolved. Outside the lattice: the
  // background.
  double StoredVertex(const Vec3i& vertex) const noexcept;
  double ResolvedVertex(const Vec3i& vertex) const noexcept {
    return ResolvedDensity(StoredVertex(vertex), vertex.x(), vertex.y(), vertex.z());
  }

  // The volume revision at which the densities of a cell may have changed last: the last change of
  // a brick that has one of the cell's corners. Never too low.
  std::uint64_t CellRevision(const Vec3i& cell) const noexcept;

  // True if the cell is within the padded lattice. All other cells are free space.
  bool HasCell(const Vec3i& cell) const noexcept {
    return (cell.array() >= -1).all() && (cell.array() < metadata_.size.array()).all();
  }

 private:
  VolumeMetadata metadata_;
  double inverse_range_;
  BrickDirectory bricks_;
  std::uint64_t revision_;
  std::uint64_t loaded_revision_;
};

}  // namespace palpate
