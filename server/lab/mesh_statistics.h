// Topology of a triangle mesh, by its indices alone.
//
// Threads: any ordinary thread; works on all cores.
#pragma once

#include <cstdint>

#include "server/lab/mesh.h"

namespace palpate::lab {

struct MeshStatistics {
  std::int64_t vertices = 0;
  std::int64_t edges = 0;
  std::int64_t triangles = 0;
  std::int64_t components = 0;
  std::int64_t euler = 0;                      // Euler characteristic: vertices - edges + triangles
  std::int64_t boundary_edges = 0;             // of one triangle
  std::int64_t boundary_edges_off_border = 0;  // those that lie in no face of the mesh's range
  std::int64_t boundary_loops = 0;
  std::int64_t non_manifold_edges = 0;     // of three triangles or more
  std::int64_t misoriented_edges = 0;      // of two triangles that run along it alike
  std::int64_t non_manifold_vertices = 0;  // whose triangles form no single fan

  bool IsManifold() const {
    return non_manifold_edges == 0 && non_manifold_vertices == 0 && misoriented_edges == 0;
  }
  // Sum over the components, each boundary loop closed by a disk. Of a manifold.
  std::int64_t genus() const { return components - (euler + boundary_loops) / 2; }
};

MeshStatistics MeasureMesh(const SurfaceMesh& mesh);

}  // namespace palpate::lab
