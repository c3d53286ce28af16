#include "client/view/drawing/haptic_patch.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/isosurface/cell.h"
#include "common/isosurface/sub_cell.h"

namespace palpate::view {
namespace {

// Converts data units to densities with exactly the daemon's operations: H depends on single bits.
struct Normalization {
  double min;
  double range;
  double inverse_range = 1.0 / range;

  double Density(double value) const { return (value - min) * inverse_range; }
  // Returns the largest density whose data value is not above the isovalue.
  double OfIsovalue(double isovalue) const {
    double density = Density(isovalue);
    while (min + density * range > isovalue) {
      density = std::nextafter(density, -std::numeric_limits<double>::infinity());
    }
    return density;
  }
};

CellDensities ResolvedCell(const ViewVolume& volume, const Normalization& normalization,
                           const Vec3i& cell) {
  // Only a level set has a background other than the least value.
  const double outside = volume.lattice()->background ? kAboveAllIsovalues : 0.0;
  CellDensities densities;
  for (int v = 0; v < 8; ++v) {
    const Vec3i p = cell + Vec3i(kCornerOffset[v][0], kCornerOffset[v][1], kCornerOffset[v][2]);
    const bool is_within =
        (p.array() >= 0).all() && (p.array() < volume.lattice()->size.array()).all();
    const double stored = is_within ? normalization.Density(volume.Value(p)) : outside;
    densities[v] = ResolvedDensity(stored, p.x(), p.y(), p.z());
  }
  return densities;
}

// Where H crosses the edge between two vertices. Computed from the free end, so that every cell
// gets the same point.
Vec3 Crossing(const Decomposition& parts, double isovalue, const Vec3& origin, int u, int v) {
  if (parts.density[u] > parts.density[v]) std::swap(u, v);
  const double low = parts.density[u], high = parts.density[v];
  const Vec3 from = origin + parts.position[u], to = origin + parts.position[v];
  return from + (isovalue - low) / (high - low) * (to - from);
}

// True if the next cell along an axis is in the patch, too. Its lines in the common face are the
// same.
bool IsLeftToNext(const Decomposition& parts, const std::array<int, 3>& face, const Vec3i& cell,
                  const Vec3i& last) {
  for (int axis = 0; axis < 3; ++axis) {
    const auto is_far = [&](int v) { return parts.position[v][axis] == 1.0; };
    if (cell[axis] < last[axis] && std::all_of(face.begin(), face.end(), is_far)) return true;
  }
  return false;
}

// H within a tetrahedron is bounded by one line in each face that it crosses. The line joins the
// two edges at the vertex that is alone on its side. `last`: the patch's last cell.
void AddEdges(const Decomposition& parts, double isovalue, const Vec3i& cell, const Vec3i& last,
              std::vector<Vec3>& points) {
  const TetrahedralComplex& complex = parts.complex;
  std::vector<unsigned> seen;  // faces, by the mask of their vertices
  for (int t = 0; t < complex.tetrahedron_count; ++t) {
    for (int opposite = 0; opposite < 4; ++opposite) {
      std::array<int, 3> face{};
      unsigned mask = 0, above = 0;
      for (int n = 0, f = 0; n < 4; ++n) {
        if (n == opposite) continue;
        face[f] = complex.vertices[t][n];
        mask |= 1u << face[f];
        above += parts.density[face[f]] > isovalue;
        ++f;
      }
      if (above == 0 || above == 3 || IsLeftToNext(parts, face, cell, last)) continue;
      if (std::find(seen.begin(), seen.end(), mask) != seen.end()) continue;
      seen.push_back(mask);
      const auto is_alone = [&](int v) { return (parts.density[v] > isovalue) == (above == 1); };
      std::rotate(face.begin(), std::find_if(face.begin(), face.end(), is_alone), face.end());
      const Vec3 origin = cell.cast<double>();
      points.push_back(Crossing(parts, isovalue, origin, face[0], face[1]));
      points.push_back(Crossing(parts, isovalue, origin, face[0], face[2]));
    }
  }
}

}  // namespace

std::vector<Vec3> HapticPatch(const ViewVolume& volume, double isovalue, DecompositionMethod method,
                              int refinement, const Vec3& center_I, double radius_voxels) {
  std::vector<Vec3> points;
  if (!volume.lattice() || !center_I.allFinite() || !(radius_voxels >= 0.0)) return points;
  const VolumeLattice& lattice = *volume.lattice();
  const Normalization normalization{lattice.value_min, lattice.value_max - lattice.value_min};
  const double density = normalization.OfIsovalue(isovalue);
  // In floating point: places far away do not fit an int.
  const Vec3 least = Vec3::Constant(-1.0);
  const Vec3 most = lattice.size.cast<double>();
  const Vec3 reach = Vec3::Constant(radius_voxels);
  const Vec3 low = (center_I - reach).array().floor().matrix().cwiseMax(least).cwiseMin(most);
  const Vec3 high = (center_I + reach).array().floor().matrix().cwiseMin(most - Vec3::Ones());
  const Vec3i first = low.cast<int>(), last = high.cwiseMax(least - Vec3::Ones()).cast<int>();
  for (int i = first.x(); i <= last.x(); ++i) {
    for (int j = first.y(); j <= last.y(); ++j) {
      for (int k = first.z(); k <= last.z(); ++k) {
        const Vec3i cell(i, j, k);
        const CellDensities densities = ResolvedCell(volume, normalization, cell);
        if (!IsCrossed(densities, density)) continue;
        for (int n = 0; n < refinement * refinement * refinement; ++n) {
          const Vec3i sub(n / (refinement * refinement), n / refinement % refinement,
                          n % refinement);
          const CellDensities part = SubCell(densities, sub, refinement);
          if (!IsCrossed(part, density)) continue;
          // On the daemon's refined lattice, whose index -1 is the voxels'
          // (server/volume/snapshot/lattice.h).
          const Vec3i in_L = refinement * (cell + Vec3i::Ones()) - Vec3i::Ones() + sub;
          const Vec3i last_in_L = refinement * (last + Vec3i::Constant(2)) - Vec3i::Constant(2);
          AddEdges(Decompose(part, method), density, in_L, last_in_L, points);
        }
      }
    }
  }
  if (refinement == 1) return points;
  for (Vec3& point : points) point = (point + Vec3::Ones()) / refinement - Vec3::Ones();
  return points;
}

}  // namespace palpate::view
