// Grids of many kinds, their files, and what two of them differ in. OpenVDB alone makes, writes,
// reads and compares here, so that our own code is judged by another.
#pragma once

#include <filesystem>
#include <string>

#include "server/volume/snapshot/openvdb_grids.h"

namespace palpate::testing {

// A grid with metadata of every type that we keep, an edge of so many voxels:
//   sphere                 level set, voxels of 0.5 mm
//   cloud                  scattered leaves and tiles of all levels, inactive values, odd nodes
//   negative               background -1000, turned, with three spacings
//   uint8 int16 int32      integers within and beyond the range of these types
//   double half bool       of these types
//   vector                 unit vectors
//   frustum                a transform that is not linear
openvdb::GridBase::Ptr MakeVdbGrid(const std::string& kind, int edge = 64, unsigned seed = 1);

void WriteVdb(const std::filesystem::path& path, const openvdb::GridCPtrVec& grids);
// The only grid of the file.
openvdb::GridBase::Ptr ReadVdb(const std::filesystem::path& path);

// One line about the first difference between two grids and their trees, bit by bit; empty: they
// are equal. `is` may have more metadata whose names begin with palpate_ or file_. `rounded`:
// values are compared as floats.
std::string VdbDifference(const openvdb::GridBase& expected, const openvdb::GridBase& is,
                          bool rounded = false);

}  // namespace palpate::testing
