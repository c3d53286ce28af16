// Guesses whether a volume is of a patient. Pure; any thread.
#pragma once

#include "common/bricks/volume_event.h"

namespace palpate::client {

// True if the file turns the voxels in its world, or moves the first one away from the origin; or
// if the values are Hounsfield units. Files of other things state a spacing at most, but .vdb files
// have a place, too. A patient's file without a turn and a place is not recognised.
inline bool IsOfPatient(const VolumeLattice& lattice) {
  const Mat3 cosines = lattice.X_WI.linear.colwise().normalized();
  const bool is_turned = !cosines.isIdentity(1e-6);
  const bool is_placed = !lattice.X_WI.translation.isZero(0.0) && !lattice.source.ends_with(".vdb");
  return lattice.unit == "HU" || is_turned || is_placed;
}

}  // namespace palpate::client
