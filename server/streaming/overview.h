// A coarse picture of a volume: means of blocks of 4³ voxels.
//
// Threads: pure. Not real-time.
#pragma once

#include <cstdint>
#include <span>

#include "server/volume/snapshot.h"

namespace palpate {

// Blocks along each axis.
Vec3i OverviewSize(const Vec3i& size_voxels);

// Means of blocks `first` and those after it, over the voxels that lie within the
// lattice; block (i, j, k) of (ni, nj, nk) is the one of number (i nj + j) nk + k.
void FillOverview(const VolumeSnapshot& volume, std::uint64_t first, std::span<float> means);

}  // namespace palpate
