// Finds the distance from a point to the nearest triangle of a mesh, by a uniform grid.
//
// Frame: D (mm). Threads: any, after construction. Errors: none.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/lab/mesh.h"

namespace palpate::lab {

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
