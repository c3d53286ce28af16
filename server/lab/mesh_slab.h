// One slab of a mesh: the triangles of a few layers of cells along x.
//
// The plane between two slabs is the lower plane of the upper slab. Edges of the complex in this
// plane belong to the upper slab; the lower slab refers to them by key.
//
// Frame: L, index of the lattice. Threads: pure; slabs are made in parallel.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "server/lab/mesh.h"

namespace palpate::lab {

// Marks a triangle's vertex as an entry of `upper` instead of `vertices`.
inline constexpr std::uint32_t kInUpperPlane = 1u << 31;

struct PlaneVertex {
  std::uint64_t key;    // identifies the edge within the plane
  std::uint32_t index;  // index of the vertex in the slab that owns it
};

struct MeshSlab {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<PlaneVertex> lower;    // in the plane shared with the slab below, sorted by key
  std::vector<std::uint64_t> upper;  // keys in the plane shared with the slab above
};

struct SlabRequest {
  const Lattice& lattice;
  double isovalue;
  ComparedMethod method;
  CellRange range;      // the cells of the slab
  bool has_slab_above;  // false: this slab owns the vertices in its upper plane
};

// Throws kTooLarge above 2³¹ vertices in a slab.
MeshSlab MakeSlab(const SlabRequest& request);

}  // namespace palpate::lab
