// Extracts the haptic isosurface H of a whole volume as an indexed triangle mesh.
//
// A vertex of the mesh lies on an edge of the tetrahedral complex. The edge identifies the vertex;
// the position does not. Cells that share a face share its vertices, so the mesh has no seams,
// whatever the densities are. A tetrahedron gives one triangle, or two that split a quadrilateral.
// Normals (counter-clockwise) point to free space.
//
// Frame: L, index of the lattice; without refinement I, voxel index. Isovalues are normalised.
// Threads: any ordinary thread; works on all cores. The mesh is the same for any number of cores.
// Errors: Error.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/lab/compared_method.h"
#include "server/volume/snapshot/lattice.h"

namespace palpate::lab {

// Cells first .. end-1 along each axis. Their lattice vertices are first .. end.
struct CellRange {
  Vec3i first;
  Vec3i end;
};

// All cells of the padded lattice. H is closed there if the isovalue is 0 or more.
inline CellRange PaddedCells(const Lattice& lattice) {
  return {Vec3i::Constant(-1), lattice.size()};
}

struct SurfaceMesh {
  std::vector<Vec3> vertices;  // L
  std::vector<std::array<std::uint32_t, 3>> triangles;
  CellRange range;  // the cells that the mesh was made of
};

// Called with the fraction done, rising from 0 to 1. Only one thread calls at a time.
using MeshProgress = std::function<void(double fraction)>;

// `progress` may be empty. Throws kTooLarge above 2³¹ vertices or 2³² / 3 triangles.
SurfaceMesh ExtractSurface(const Lattice& lattice, double isovalue, ComparedMethod method,
                           const CellRange& range, const MeshProgress& progress = {});

}  // namespace palpate::lab
