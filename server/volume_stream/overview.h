// Computes a coarse picture of a volume: the means of blocks of 4³ voxels.
//
// Threads: pure. Not real-time.
#pragma once

#include <cstdint>
#include <span>

#include "server/volume/snapshot/snapshot.h"

namespace palpate {

// The number of blocks along each axis.
Vec3i OverviewSize(const Vec3i& size_voxels);

// Computes the means of block `first` and the blocks after it, over the voxels within the lattice.
// Block (i, j, k) of (ni, nj, nk) has the number (i nj + j) nk + k.
void FillOverview(const VolumeSnapshot& volume, std::uint64_t first, std::span<float> means);

}  // namespace palpate
