// The parts of vdb_tool, a child program that writes .vdb files and judges them. It uses OpenVDB
// alone: it shares nothing with the code that it judges.
#pragma once

#include <openvdb/openvdb.h>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace palpate::vdb_tool {

// Wrong usage, or a file that lacks what was asked for; one line.
class Failure : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// --- vdb_tool_make.cpp
struct MakeOptions {
  int edge = 64;  // voxels
  unsigned seed = 1;
};

// The grids of a file of this kind. Throws Failure for an unknown kind.
openvdb::GridPtrVec MakeGrids(const std::string& kind, const MakeOptions& options);
// All kinds, in one line.
std::string KindNames();

// --- vdb_tool_compare.cpp
struct Difference {
  std::int64_t voxels = 0;  // of another value or state
  std::int64_t nodes = 0;   // places where one tree has a node and the other has a tile
  openvdb::CoordBBox box;   // of the voxels
  std::string first;        // what differs first; empty: nothing does
};

// Of the trees alone. Throws Failure where the grids are of different types.
Difference CompareTrees(const openvdb::GridBase& a, const openvdb::GridBase& b);

// One line about what differs first between two grids and their trees; empty: they are equal.
// `b` may have more metadata than `a` where the names begin with palpate_ or file_.
// `rounded`: the values of both are rounded to float before they are compared, and the types of
// the values may differ.
std::string FirstDifference(const openvdb::GridBase& a, const openvdb::GridBase& b, bool rounded);

// --- vdb_tool_change.cpp
// Changes one thing of a grid of floats.
void Change(const std::string& what, openvdb::FloatGrid& grid);
std::string ChangeNames();
// The bytes of a file, damaged.
std::vector<char> Damaged(std::vector<char> bytes, unsigned seed);

// visit(grid) with the grid's own type, of those that CompareTrees knows; false for others.
template <class Visit>
bool VisitGrid(const openvdb::GridBase& grid, Visit&& visit) {
  using Types = openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid,
                                  openvdb::Int64Grid, openvdb::BoolGrid, openvdb::Vec3SGrid>;
  return grid.apply<Types>(std::forward<Visit>(visit));
}

}  // namespace palpate::vdb_tool
