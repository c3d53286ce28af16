// The voxels of a lattice, one after the other.
#pragma once

#include <gtest/gtest.h>

#include "common/geometry/geometry.h"

namespace palpate::testing {

// Calls visit(voxel) for each voxel of the lattice, until an ASSERT of the test fails.
template <typename Visit>
void ForEachVoxel(const Vec3i& size, const Visit& visit) {
  Vec3i p;
  for (p.x() = 0; p.x() < size.x(); ++p.x()) {
    for (p.y() = 0; p.y() < size.y(); ++p.y()) {
      for (p.z() = 0; p.z() < size.z(); ++p.z()) {
        visit(p);
        if (::testing::Test::HasFatalFailure()) return;
      }
    }
  }
}

}  // namespace palpate::testing
