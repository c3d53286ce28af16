// Shared by the tests of accuracy: built-in volumes, and all facets of their H. Next to the surface
// s = 0, the density of these volumes is ½ - s / 8, with s smooth and in voxels.
//
// Why facets bound the proxy and its force: a proxy at rest is a local minimum of its distance to
// the HIP. No direction into free space at the proxy's place x comes closer to the HIP. These
// directions include all that no facet of H through x excludes. So (Farkas) the spring force lies
// in the cone that the normals of those facets span. For a given direction, all directions within
// an angle below 90° also form a convex cone. So the force deviates from the exact normal by no
// more than the facets' normals do.
//
// How far H is from s = 0: the density of H at a point is a weighted mean of the densities at the
// cell's corners. The centre of the weights is the point, and their variance is at most ¼ per axis.
// So s is off by at most 3/8 of the greatest second derivative of s. If vertices are in the middle
// of faces and cells, each component of H's gradient is a mean of that component of ∇s over edges
// of the cell: H turns away no more than ∇s does across the cell. Both hold for these volumes
// although saddles move vertices; the tests check this.
//
// Frame: index coordinates, in voxels, unless the name says otherwise.
// Threads: one.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <numbers>
#include <random>
#include <string_view>

#include "server/haptics/haptic_surface.h"
#include "server/volume/builtin.h"
#include "server/volume/snapshot_builder.h"

namespace palpate::testing {

inline constexpr double kIsovalue = 0.5;
inline constexpr double kVoxelsPerDensity = 8.0;  // change of s per density
inline constexpr double kStepMm = 0.1;            // of the HIP per tick: 10 cm/s
// The most that s moves because densities are stored as float near ½, and ties are lowered.
inline constexpr double kStoredError = kVoxelsPerDensity * (0x1p-25 + kTieStep);
// The greatest allowed residual of HIP - SCP_H at a resting proxy. The force is then at most this
// far from its cone, as a sine (Moreau).
inline constexpr double kRestResidual = 1e-6;
// The most steps towards the same HIP, after which the bound on moves no longer matters.
inline constexpr int kMaxSteps = 8;

enum class Motion { kPath, kTeleports };

inline std::shared_ptr<const VolumeSnapshot> Load(std::string_view source) {
  const BuiltinVolume builtin = MakeBuiltin(source);
  return MakeSnapshot(builtin.grid, builtin.metadata, 1);
}

inline HapticSurface Surface(const VolumeSnapshot& volume, double voxels_per_mm) {
  return MakeHapticSurface(volume, {Mat3::Identity() / voxels_per_mm, Vec3::Zero()}, kIsovalue,
                           DecompositionMethod::kTpbcc, 1);
}

inline double Degrees(double rad) { return rad * 180.0 / std::numbers::pi; }

// The part of H within a tetrahedron: a flat convex polygon.
struct Facet {
  Vec3 normal = Vec3::Zero();  // towards free space, unit
  int count = 0;
  std::array<Vec3, 4> corner{};  // in no order
};

inline Facet FacetIn(const Decomposition& parts, int tetrahedron, const Vec3& origin) {
  const auto& v = parts.complex.vertices[tetrahedron];
  Facet facet;
  Mat3 edges;
  Vec3 rises;
  for (int a = 0; a < 4; ++a) {
    if (a > 0) {
      edges.row(a - 1) = (parts.position[v[a]] - parts.position[v[0]]).transpose();
      rises[a - 1] = parts.density[v[a]] - parts.density[v[0]];
    }
    for (int b = 0; b < a; ++b) {
      const double low = parts.density[v[a]] - kIsovalue, high = parts.density[v[b]] - kIsovalue;
      if ((low > 0.0) == (high > 0.0)) continue;
      const double share = low / (low - high);
      facet.corner[facet.count++] =
          origin + (1.0 - share) * parts.position[v[a]] + share * parts.position[v[b]];
    }
  }
  facet.normal = -(edges.inverse() * rises).normalized();
  return facet;
}

// Calls visit(facet) for every facet of H. Ties are resolved, so no vertex lies on H, and every
// tetrahedron with a point of H has a facet.
template <class Visitor>
void VisitFacets(const VolumeSnapshot& volume, Visitor visit) {
  Vec3i cell;
  for (cell.x() = -1; cell.x() < volume.size().x(); ++cell.x()) {
    for (cell.y() = -1; cell.y() < volume.size().y(); ++cell.y()) {
      for (cell.z() = -1; cell.z() < volume.size().z(); ++cell.z()) {
        const CellDensities d = volume.StoredCell(cell);
        const auto [low, high] = std::minmax_element(d.begin(), d.end());
        if (*low > kIsovalue + kTieStep || *high < kIsovalue) continue;
        const Decomposition parts =
            Decompose(VolumeSnapshot::WithTiesResolved(d, cell), DecompositionMethod::kTpbcc);
        for (int t = 0; t < parts.complex.tetrahedron_count; ++t) {
          const Facet facet = FacetIn(parts, t, cell.cast<double>());
          if (facet.count > 0) visit(facet);
        }
      }
    }
  }
}

inline Vec3 RandomDirection(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  for (;;) {
    const Vec3 v(normal(random), normal(random), normal(random));
    if (v.norm() > 0.1) return v.normalized();
  }
}

// A direction that wanders over the whole sphere.
class Wanderer {
 public:
  explicit Wanderer(std::uint64_t seed)
      : random_(seed), direction_(RandomDirection(random_)), axis_(RandomDirection(random_)) {}

  const Vec3& Next(double angle_rad) {
    axis_ += 0.03 * RandomDirection(random_);
    axis_ = (axis_ - axis_.dot(direction_) * direction_).normalized();
    direction_ = (Eigen::AngleAxisd(angle_rad, axis_) * direction_).normalized();
    return direction_;
  }

 private:
  std::mt19937_64 random_;
  Vec3 direction_, axis_;
};

}  // namespace palpate::testing
