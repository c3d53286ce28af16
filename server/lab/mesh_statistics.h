// Measures the topology of a triangle mesh. Uses its indices; positions tell only what lies in the
// border.
//
// Threads: any ordinary thread; works on all cores. Apart for its tests.
#pragma once

#include <cstdint>

#include "server/lab/mesh.h"

namespace palpate::lab {

struct MeshStatistics {
  std::int64_t vertices = 0;
  std::int64_t edges = 0;
  std::int64_t triangles = 0;
  std::int64_t components = 0;
  std::int64_t euler = 0;           // Euler characteristic: vertices - edges + triangles
  std::int64_t boundary_edges = 0;  // edges of one triangle only
  // boundary edges that lie in no face of the mesh's range
  std::int64_t boundary_edges_off_border = 0;
  std::int64_t boundary_loops = 0;
  std::int64_t non_manifold_edges = 0;  // edges of three triangles or more
  // edges whose two triangles run along them in the same direction
  std::int64_t misoriented_edges = 0;
  std::int64_t non_manifold_vertices = 0;  // vertices whose triangles do not form one fan

  bool IsManifold() const {
    return non_manifold_edges == 0 && non_manifold_vertices == 0 && misoriented_edges == 0;
  }
  // The sum over all components, with each boundary loop closed by a disk. Valid only for a
  // manifold.
  std::int64_t genus() const { return components - (euler + boundary_loops) / 2; }
};

MeshStatistics MeasureMesh(const SurfaceMesh& mesh);

}  // namespace palpate::lab
