// Distances of a point to triangles and tetrahedra, and to the nearest triangle of a mesh.
//
// Frame: D (mm). Threads: any, after construction. Errors: none.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/lab/mesh.h"

namespace palpate::lab {

// Exact up to rounding, also for slivers and degenerate triangles: the result is always the
// distance to some point of the figure.
double SquaredDistanceToTriangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c);

// 0 inside.
double SquaredDistanceToTetrahedron(const Vec3& p, const std::array<Vec3, 4>& corner);

// A mesh in a uniform grid.
class TriangleGrid {
 public:
  // Transforms the mesh to D.
  TriangleGrid(const SurfaceMesh& mesh, const AffineMap& X_DI);

  // Returns limit_mm if no triangle is nearer.
  double Distance(const Vec3& p_mm, double limit_mm) const;

 private:
  Vec3i BoxAt(const Vec3& p_mm) const;
  std::size_t IndexOf(const Vec3i& box) const;
  void Sort();
  double NearestInBox(const Vec3i& box, const Vec3& p_mm, double nearest_squared) const;
  double NearestOnShell(const Vec3i& middle, int radius, const Vec3& p_mm,
                        double nearest_squared) const;

  std::vector<Vec3> vertices_mm_;
  std::vector<std::array<std::uint32_t, 3>> triangles_;
  Vec3 low_mm_ = Vec3::Zero();
  double edge_mm_ = 1.0;
  Vec3i count_ = Vec3i::Ones();
  // Triangles whose bounding box meets grid box b: listed_[first_[b]] .. [first_[b + 1]].
  std::vector<std::uint32_t> first_;
  std::vector<std::uint32_t> listed_;
};

}  // namespace palpate::lab
