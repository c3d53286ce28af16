// Checks whether a proxy can have moved from one position to the next within a tick.
//
// Uses only three positions (before, after, HIP) and the decomposed cells. Two rules of the method
// are enough, whatever the proxy does in between:
// - In free space, the proxy goes straight towards the HIP, up to the first point where H stops it.
// - From there, its distance to the HIP never grows. So its path lies in the free space within the
//   ball around the HIP through that point.
// The second rule is decided exactly. The free part of a tetrahedron is convex, and so is its part
// within the ball. Two such parts are connected if the free part of their common face meets the
// ball. The space beyond the padded lattice is six half-spaces.
//
// Neighbours are found by position. This code does not use the proxy's places, cones and moves.
// Frame: D (mm). Threads: one per object.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <queue>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "server/lab/fresh_cells.h"
#include "server/lab/triangle_grid.h"

namespace palpate::testing {

class PathJudge {
 public:
  explicit PathJudge(const HapticSurface& surface) : cells_(surface) {}

  bool MayHaveCome(const Vec3& from_mm, const Vec3& to_mm, const Vec3& p_DHip_mm) {
    if (from_mm == to_mm || IsInOnePart(from_mm, to_mm, p_DHip_mm)) return true;
    const double reached = WayToMaterial(from_mm, p_DHip_mm);
    const Vec3 contact_mm = from_mm + reached * (p_DHip_mm - from_mm);
    hip_mm_ = p_DHip_mm;
    radius_mm_ = (contact_mm - hip_mm_).norm() * (1.0 + kTolerance) +
                 kTolerance * (cells_.surface().voxel_mm + hip_mm_.norm());
    return (to_mm - hip_mm_).norm() <= radius_mm_ && IsConnected(contact_mm, to_mm);
  }

  // The parts that contain a position. Valid until the next but one call.
  const lab::Holders& HoldersAt(const Vec3& p_mm) {
    for (const Held& held : held_) {
      if (held.p_mm == p_mm) return held.holders;
    }
    next_held_ ^= 1;
    held_[next_held_] = {p_mm, cells_.HoldersOf(surface().X_LD.Apply(p_mm))};
    return held_[next_held_].holders;
  }

  lab::FreshCells& cells() { return cells_; }

 private:
  // For lengths in voxels, for densities, and for fractions of a path.
  static constexpr double kTolerance = 1e-9;
  // For densities on a straight path: a slight slope must not move its end by much.
  static constexpr double kWayTolerance = 1e-12;
  // For barycentric weights: a path along a face is in the tetrahedra of both sides.
  static constexpr double kFaceSlack = 1e-12;

  // The free part of a tetrahedron of a cell, or of the half-space beyond a side of the lattice.
  // `side`: 0 to 5, 2 * axis + (1 at the upper end).
  struct Part {
    std::uint64_t cell = 0;
    int tetrahedron = 0;
    int side = -1;
    Vec3i at = Vec3i::Zero();

    auto key() const { return std::tuple(cell, tetrahedron, side); }
    bool operator<(const Part& other) const { return key() < other.key(); }
  };

  struct Corner {
    Vec3 p_mm;
    double density;  // felt
  };

  struct Held {
    Vec3 p_mm = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
    lab::Holders holders{};
  };

  const HapticSurface& surface() { return cells_.surface(); }

  // A quick check: true if both positions are in the free part of one tetrahedron, or in free space
  // beyond one side.
  bool IsInOnePart(const Vec3& from_mm, const Vec3& to_mm, const Vec3& p_DHip_mm) {
    const double from_hip = (from_mm - p_DHip_mm).norm(), to_hip = (to_mm - p_DHip_mm).norm();
    if (!(to_hip <= from_hip * (1.0 + kTolerance))) return false;
    const std::vector<Part> from = PartsAt(from_mm), to = PartsAt(to_mm);
    return std::any_of(to.begin(), to.end(), [&](const Part& part) {
      return std::any_of(from.begin(), from.end(),
                         [&](const Part& other) { return other.key() == part.key(); });
    });
  }

  // --- Straight towards the HIP

  // Returns the fraction of the path to the HIP after which the density is above τ; 1 if there is
  // no such place.
  double WayToMaterial(const Vec3& from_mm, const Vec3& p_DHip_mm) {
    const Vec3 from = surface().X_LD.Apply(from_mm), hip = surface().X_LD.Apply(p_DHip_mm);
    const Vec3i last = surface().lattice.size();
    const Vec3 low = from.cwiseMin(hip), high = from.cwiseMax(hip);
    // Beyond the lattice there is nothing to meet, and far places do not fit an integer.
    const auto cell_of = [&](const Vec3& p) -> Vec3i {
      return p.cwiseMax(-1.0)
          .cwiseMin(last.cast<double>() - Vec3::Constant(0.5))
          .array()
          .floor()
          .matrix()
          .cast<int>();
    };
    const Vec3i first_cell = cell_of(low), last_cell = cell_of(high);
    double nearest = 1.0;
    for (int x = first_cell.x(); x <= last_cell.x(); ++x) {
      for (int y = first_cell.y(); y <= last_cell.y(); ++y) {
        for (int z = first_cell.z(); z <= last_cell.z(); ++z) {
          nearest = std::min(nearest, WayToMaterialIn({x, y, z}, from, hip, nearest));
        }
      }
    }
    return nearest;
  }

  double WayToMaterialIn(const Vec3i& cell, const Vec3& from, const Vec3& hip, double nearest) {
    const lab::FreshCell& fresh = cells_.At(cell);
    if (fresh.free) return nearest;
    for (int t = 0; t < fresh.parts.complex.tetrahedron_count; ++t) {
      const auto corners = lab::CornersOf(cell, fresh, t);
      Mat3 edges;
      for (int n = 0; n < 3; ++n) edges.col(n) = corners[n + 1] - corners[0];
      const Mat3 inverse = edges.inverse();
      const Vec3 w = inverse * (from - corners[0]), dw = inverse * (hip - from);
      // The path is within all four faces from fraction `enter` to fraction `leave`.
      double enter = 0.0, leave = nearest;
      const auto cut = [&](double weight, double rate) {
        if (rate > 0.0) enter = std::max(enter, -weight / rate);
        if (rate < 0.0) leave = std::min(leave, -weight / rate);
        if (rate == 0.0 && weight < 0.0) leave = -1.0;
      };
      cut(1.0 - w.sum() + kFaceSlack, -dw.sum());
      for (int n = 0; n < 3; ++n) cut(w[n] + kFaceSlack, dw[n]);
      if (!(enter <= leave)) continue;
      const std::array<double, 4> d = lab::DensitiesOf(fresh, t);
      double density = surface().sign() * d[0], slope = 0.0;
      for (std::size_t n = 0; n < 3; ++n) {
        density += w[static_cast<int>(n)] * surface().sign() * (d[n + 1] - d[0]);
        slope += dw[static_cast<int>(n)] * surface().sign() * (d[n + 1] - d[0]);
      }
      // How far it is beyond each bound at the start, and how that changes.
      const auto meet = [&](double inside, double rise) {
        if (inside + enter * rise > kWayTolerance) nearest = std::min(nearest, enter);
        if (inside + enter * rise <= kWayTolerance && inside + leave * rise > kWayTolerance) {
          nearest = std::min(nearest, (kWayTolerance - inside) / rise);
        }
      };
      meet(density - surface().isovalue, slope);
      meet(surface().lower - density, -slope);
    }
    return nearest;
  }

  // --- Connected within the free space of the ball

  bool IsConnected(const Vec3& from_mm, const Vec3& to_mm) {
    const std::vector<Part> goals = PartsAt(to_mm);
    using Entry = std::pair<double, Part>;  // nearest to the goal first
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
    std::set<Part> seen;
    const auto enter = [&](const Part& part) {
      if (seen.insert(part).second) open.push({(MiddleOf(part) - to_mm).norm(), part});
    };
    for (const Part& part : PartsAt(from_mm)) enter(part);
    while (!open.empty()) {
      const Part part = open.top().second;
      open.pop();
      for (const Part& goal : goals) {
        if (goal.key() == part.key()) return true;
      }
      for (const Part& next : Neighbours(part)) enter(next);
    }
    return false;
  }

  Vec3 MiddleOf(const Part& part) {
    return surface().X_DL.Apply(part.at.cast<double>() + Vec3::Constant(0.5));
  }

  Part PartOf(const lab::Holder& holder) {
    return {cells_.KeyOf(holder.cell), holder.tetrahedron, -1, holder.cell};
  }

  Part HalfSpace(int side) {
    Vec3i at = surface().lattice.size() / 2;
    at[side / 2] = side % 2 == 0 ? -2 : surface().lattice.size()[side / 2];
    return {0, 0, side, at};
  }

  // How far a point is inside the half-space, in voxels.
  double InHalfSpace(const Vec3& p_L, int side) {
    const int axis = side / 2;
    return side % 2 == 0 ? -1.0 - p_L[axis] : p_L[axis] - surface().lattice.size()[axis];
  }

  // Returns the free parts that contain a point, also on their border.
  std::vector<Part> PartsAt(const Vec3& p_mm) {
    const Vec3 p_L = surface().X_LD.Apply(p_mm);
    std::vector<Part> parts;
    for (const lab::Holder& holder : HoldersAt(p_mm).tetrahedra) {
      if (HasFreePart(holder)) parts.push_back(PartOf(holder));
    }
    if (!surface().IsFreeOutside()) return parts;
    for (int side = 0; side < 6; ++side) {
      if (InHalfSpace(p_L, side) >= -kTolerance) parts.push_back(HalfSpace(side));
    }
    return parts;
  }

  std::vector<Corner> CornersOf(const Part& part) {
    const lab::FreshCell& fresh = cells_.At(part.at);
    const auto corners = lab::CornersOf(part.at, fresh, part.tetrahedron);
    const std::array<double, 4> densities = lab::DensitiesOf(fresh, part.tetrahedron);
    std::vector<Corner> with_density;
    for (std::size_t n = 0; n < 4; ++n) {
      with_density.push_back({surface().X_DL.Apply(corners[n]), surface().sign() * densities[n]});
    }
    return with_density;
  }

  bool HasFreePart(const lab::Holder& holder) {
    return cells_.HasFreePart(lab::DensitiesOf(cells_.At(holder.cell), holder.tetrahedron));
  }

  // The part of a polygon with sign * density <= sign * bound.
  static std::vector<Corner> Cut(const std::vector<Corner>& polygon, double bound, double sign) {
    std::vector<Corner> within;
    for (std::size_t n = 0; n < polygon.size(); ++n) {
      const Corner &a = polygon[n], &b = polygon[(n + 1) % polygon.size()];
      const bool holds_a = sign * a.density <= sign * bound;
      if (holds_a) within.push_back(a);
      if (holds_a == (sign * b.density <= sign * bound)) continue;
      const double share = (bound - a.density) / (b.density - a.density);
      within.push_back({a.p_mm + share * (b.p_mm - a.p_mm), bound});
    }
    return within;
  }

  // True if the free part of a triangle meets the ball.
  bool IsWithinReach(const std::vector<Corner>& triangle) {
    const std::vector<Corner> free =
        Cut(Cut(triangle, surface().isovalue, 1.0), surface().lower, -1.0);
    for (std::size_t n = 2; n < free.size(); ++n) {
      const double squared =
          lab::SquaredDistanceToTriangle(hip_mm_, free[0].p_mm, free[n - 1].p_mm, free[n].p_mm);
      if (squared <= radius_mm_ * radius_mm_) return true;
    }
    return false;
  }

  std::vector<Part> Neighbours(const Part& part) {
    return part.side < 0 ? NeighboursOfTetrahedron(part) : NeighboursOfHalfSpace(part.side);
  }

  std::vector<Part> NeighboursOfTetrahedron(const Part& part) {
    const std::vector<Corner> corners = CornersOf(part);
    std::vector<Part> neighbours;
    for (int left_out = 0; left_out < 4; ++left_out) {
      std::vector<Corner> face;
      Vec3 middle_mm = Vec3::Zero();
      for (int n = 0; n < 4; ++n) {
        if (n == left_out) continue;
        face.push_back(corners[n]);
        middle_mm += corners[n].p_mm / 3.0;
      }
      if (!IsWithinReach(face)) continue;
      for (const Part& beyond : PartsAt(middle_mm)) neighbours.push_back(beyond);
    }
    return neighbours;
  }

  std::vector<Part> NeighboursOfHalfSpace(int side) {
    std::vector<Part> neighbours;
    for (int other = 0; other < 6; ++other) {
      if (other / 2 != side / 2 && IsEdgeWithinReach(side, other)) {
        neighbours.push_back(HalfSpace(other));
      }
    }
    const int axis = side / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
    const Vec3i size = surface().lattice.size();
    Vec3i cell;
    cell[axis] = side % 2 == 0 ? -1 : size[axis] - 1;
    for (cell[u] = -1; cell[u] < size[u]; ++cell[u]) {
      for (cell[v] = -1; cell[v] < size[v]; ++cell[v]) AddBehind(side, cell, neighbours);
    }
    return neighbours;
  }

  // Adds the tetrahedra of a cell with a face on this side of the lattice.
  void AddBehind(int side, const Vec3i& cell, std::vector<Part>& neighbours) {
    const lab::FreshCell& fresh = cells_.At(cell);
    for (int t = 0; t < fresh.parts.complex.tetrahedron_count; ++t) {
      const Part part{cells_.KeyOf(cell), t, -1, cell};
      const auto places = lab::CornersOf(cell, fresh, t);
      const std::vector<Corner> corners = CornersOf(part);
      std::vector<Corner> face;
      for (std::size_t n = 0; n < 4; ++n) {
        if (std::abs(InHalfSpace(places[n], side)) <= kTolerance) face.push_back(corners[n]);
      }
      if (face.size() == 3 && IsWithinReach(face)) {
        neighbours.push_back(part);
      }
    }
  }

  // True if the ball meets the common part of two half-spaces.
  bool IsEdgeWithinReach(int one, int other) {
    const Vec3 hip = surface().X_LD.Apply(hip_mm_);
    // Their normals in D, of length 1, and their distances from the HIP, in mm.
    const auto plane = [&](int side) {
      const double sign = side % 2 == 0 ? -1.0 : 1.0;
      const Vec3 row = sign * surface().X_LD.linear.row(side / 2).transpose();
      return std::pair<Vec3, double>(row.normalized(), -InHalfSpace(hip, side) / row.norm());
    };
    const auto [a, way_a] = plane(one);
    const auto [b, way_b] = plane(other);
    double distance_mm = 0.0;
    const double cosine = a.dot(b);
    if (way_a > 0.0 && way_b <= way_a * cosine) {
      distance_mm = way_a;
    } else if (way_b > 0.0 && way_a <= way_b * cosine) {
      distance_mm = way_b;
    } else if (way_a > 0.0 || way_b > 0.0) {
      // The distance to the line where both planes meet.
      const double sine2 = 1.0 - cosine * cosine;
      distance_mm =
          std::sqrt((way_a * way_a + way_b * way_b - 2.0 * cosine * way_a * way_b) / sine2);
    }
    return distance_mm <= radius_mm_;
  }

  lab::FreshCells cells_;
  std::array<Held, 2> held_;
  std::size_t next_held_ = 0;
  Vec3 hip_mm_ = Vec3::Zero();
  double radius_mm_ = 0.0;
};

}  // namespace palpate::testing
