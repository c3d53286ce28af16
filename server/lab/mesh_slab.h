// One slab of a mesh: the triangles of a few layers of cells along x.
//
// Edges of the complex that lie in the plane between two slabs belong to the
// upper slab, which has the plane as its lower one; the lower slab refers to them
// by their key.
//
// Frame: I, voxel index. Threads: pure; slabs are made in parallel.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "server/lab/mesh.h"

namespace palpate::lab {

// Marks a triangle's vertex as an entry of `upper` instead of `vertices`.
inline constexpr std::uint32_t kInUpperPlane = 1u << 31;

struct PlaneVertex {
  std::uint64_t key;    // of the edge, within the plane
  std::uint32_t index;  // of the vertex in the slab that has it
};

struct MeshSlab {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<PlaneVertex> lower;    // in the plane shared with the slab below, by key
  std::vector<std::uint64_t> upper;  // keys in the plane shared with the slab above
};

struct SlabRequest {
  const VolumeSnapshot& volume;
  double isovalue;
  DecompositionMethod method;
  CellRange range;      // of the slab
  bool has_slab_above;  // else the upper plane's vertices are its own
};

// kTooLarge beyond 2³¹ vertices in a slab.
MeshSlab MakeSlab(const SlabRequest& request);

}  // namespace palpate::lab
