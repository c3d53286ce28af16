// The parts of vdb_tool, a child program that writes and checks .vdb files. It uses only OpenVDB,
// and no code that it checks.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "server/volume/openvdb_grids.h"

namespace palpate::vdb_tool {

// Wrong usage, or something is missing in the file; one line.
class Failure : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// --- vdb_tool_make.cpp
struct MakeOptions {
  int edge = 64;  // voxels
  unsigned seed = 1;
};

// Makes the grids of a file of this kind. Throws Failure for an unknown kind.
openvdb::GridPtrVec MakeGrids(const std::string& kind, const MakeOptions& options);
// All kinds, in one line.
std::string KindNames();

// --- vdb_tool_compare.cpp
struct Difference {
  std::int64_t voxels = 0;  // with another value or state
  std::int64_t nodes = 0;   // places where one tree has a node and the other has a tile
  openvdb::CoordBBox box;   // of the voxels
  std::string first;        // the first difference; empty: there is none
};

// Compares only the trees. Throws Failure if the grids have different types.
Difference CompareTrees(const openvdb::GridBase& a, const openvdb::GridBase& b);

// Returns one line about the first difference between two grids and their trees; empty: they are
// equal. `b` may have additional metadata whose names begin with palpate_ or file_. `rounded`:
// rounds all values to float before comparing them; the types of the values may then differ.
std::string FirstDifference(const openvdb::GridBase& a, const openvdb::GridBase& b, bool rounded);

// --- vdb_tool_change.cpp
// Makes one change to a grid of floats.
void Change(const std::string& what, openvdb::FloatGrid& grid);
std::string ChangeNames();
// Returns the bytes of a file with damage.
std::vector<char> Damaged(std::vector<char> bytes, unsigned seed);

// Calls visit(grid) with the grid's own type. Returns false for types that CompareTrees does not
// know.
template <class Visit>
bool VisitGrid(const openvdb::GridBase& grid, Visit&& visit) {
  using Types = openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid,
                                  openvdb::Int64Grid, openvdb::BoolGrid, openvdb::Vec3SGrid>;
  return grid.apply<Types>(std::forward<Visit>(visit));
}

}  // namespace palpate::vdb_tool
