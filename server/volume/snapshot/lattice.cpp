#include "server/volume/snapshot/lattice.h"

namespace palpate {

CellDensities Lattice::ResolvedCell(const Vec3i& cell) const noexcept {
  if (refinement_ == 1) return volume_->ResolvedCell(cell);
  const Part part = PartOf(cell);
  return SubCell(volume_->ResolvedCell(part.voxel_cell), part.sub, refinement_);
}

}  // namespace palpate
