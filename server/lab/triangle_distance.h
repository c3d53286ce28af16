// Distances to triangles and tetrahedra.
//
// Exact up to rounding, also for slivers and degenerate triangles: the result is always the
// distance to some point of the figure.
// Threads: pure functions.
#pragma once

#include <array>

#include "common/geometry/geometry.h"

namespace palpate::lab {

double SquaredDistanceToTriangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c);

// 0 inside.
double SquaredDistanceToTetrahedron(const Vec3& p, const std::array<Vec3, 4>& corner);

}  // namespace palpate::lab
