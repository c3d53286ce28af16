#include "server/lab/trilinear_topology.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <bit>

#include "common/error/error.h"
#include "server/lab/wide_saddles.h"

namespace palpate::lab {
namespace {

// χ of the subcomplex of the octahedron that a set of its vertices spans. Bit 2 * axis + side is
// the vertex on this side of the axis.
constexpr std::array<std::int8_t, 64> kOctahedronEuler = [] {
  std::array<std::int8_t, 64> euler{};
  for (unsigned set = 0; set < 64; ++set) {
    // Faces of the octahedron are sets without opposite vertices.
    for (unsigned simplex = 1; simplex < 64; ++simplex) {
      const bool opposite = (simplex & simplex >> 1 & 0b010101) != 0;
      if (opposite || (simplex & set) != simplex) continue;
      euler[set] = static_cast<std::int8_t>(euler[set] + (std::popcount(simplex) % 2 ? 1 : -1));
    }
  }
  return euler;
}();
static_assert(kOctahedronEuler[0] == 0 && kOctahedronEuler[1] == 1 && kOctahedronEuler[3] == 2 &&
              kOctahedronEuler[15] == 0 && kOctahedronEuler[63] == 2);

// Counts for the solid {F > τ}. With `below`, counts for {F < τ}, and "up" means down.
class Counter {
 public:
  Counter(const VolumeSnapshot& volume, double isovalue, bool below)
      : volume_(volume), isovalue_(isovalue), below_(below) {}

  bool IsInside(double density) const { return (density > isovalue_) != below_; }

  // Adds the cell's low corner, its three low faces and its interior.
  void AddCell(const Vec3i& cell, MorseCount& count) const {
    const CellDensities d = volume_.ResolvedCell(cell);
    if (std::none_of(d.begin(), d.end(), [&](double x) { return IsInside(x); })) return;
    if (IsInside(d[0])) Add(1 - VertexLink(cell, d), count.vertices, count);
    for (int axis = 0; axis < 3; ++axis) Add(FaceTerm(cell, axis, d), count.face_saddles, count);
    const BodyCriticals body = FindBodyCriticals(d, isovalue_);
    for (int n = 0; n < body.count; ++n) Add(BodyTerm(body.point[n]), count.body_saddles, count);
  }

 private:
  static void Add(int term, std::int64_t& kind, MorseCount& count) {
    kind += term != 0;
    count.solid += term;
  }

  bool IsUp(double from, double to) const { return (to > from) != below_; }

  int VertexLink(const Vec3i& vertex, const CellDensities& d) const {
    unsigned up = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3i step = Vec3i::Unit(axis);
      const double high = d[CornerAt(step.x(), step.y(), step.z())];
      const double low = volume_.ResolvedVertex(vertex - step);
      up |= static_cast<unsigned>(IsUp(d[0], low)) << (2 * axis);
      up |= static_cast<unsigned>(IsUp(d[0], high)) << (2 * axis + 1);
    }
    return kOctahedronEuler[up];
  }

  // The face at the cell's low end of the axis.
  int FaceTerm(const Vec3i& cell, int axis, const CellDensities& d) const {
    std::array<double, 4> face, behind, front;
    for (int n = 0; n < 4; ++n) {
      face[n] = d[kFaceCorners[2 * axis][n]];
      front[n] = d[kFaceCorners[2 * axis + 1][n]];
    }
    if (std::none_of(face.begin(), face.end(), [&](double x) { return IsInside(x); })) return 0;
    for (int n = 0; n < 4; ++n) {
      const auto& o = kCornerOffset[kFaceCorners[2 * axis][n]];
      behind[n] = volume_.ResolvedVertex(cell + Vec3i(o[0], o[1], o[2]) - Vec3i::Unit(axis));
    }
    const FaceCritical saddle = FindFaceCritical(face, behind, front, isovalue_);
    if (!saddle.exists || saddle.above == below_) return 0;
    return (saddle.rises[0] != below_) + (saddle.rises[1] != below_) - 1;
  }

  int BodyTerm(const BodyCritical& saddle) const {
    if (saddle.above == below_) return 0;
    return saddle.positive_determinant != below_ ? -1 : 1;
  }

  const VolumeSnapshot& volume_;
  const double isovalue_;
  const bool below_;
};

// True if the border is above the isovalue, false if below. Throws if parts are on both sides.
bool IsBorderAbove(const VolumeSnapshot& volume, double isovalue, const CellRange& range) {
  bool above = false, below = false;
  for (int i = range.first.x(); i <= range.end.x(); ++i) {
    for (int j = range.first.y(); j <= range.end.y(); ++j) {
      const bool inner =
          i != range.first.x() && i != range.end.x() && j != range.first.y() && j != range.end.y();
      const int step = inner ? range.end.z() - range.first.z() : 1;
      for (int k = range.first.z(); k <= range.end.z(); k += step) {
        (volume.ResolvedVertex(Vec3i(i, j, k)) > isovalue ? above : below) = true;
      }
    }
  }
  if (above && below) {
    throw Error(ErrorKind::kInvalidArgument,
                "the isosurface meets the border of the cells: it is not closed there");
  }
  return above;
}

}  // namespace

MorseCount CountTrilinearTopology(const VolumeSnapshot& volume, double isovalue,
                                  const CellRange& range) {
  const Counter counter(volume, isovalue, IsBorderAbove(volume, isovalue, range));
  return tbb::parallel_reduce(
      tbb::blocked_range<int>(range.first.x(), range.end.x()), MorseCount{},
      [&](const tbb::blocked_range<int>& layers, MorseCount count) {
        for (int i = layers.begin(); i < layers.end(); ++i) {
          for (int j = range.first.y(); j < range.end.y(); ++j) {
            for (int k = range.first.z(); k < range.end.z(); ++k) {
              counter.AddCell(Vec3i(i, j, k), count);
            }
          }
        }
        return count;
      },
      [](MorseCount l, const MorseCount& r) {
        l.vertices += r.vertices;
        l.face_saddles += r.face_saddles;
        l.body_saddles += r.body_saddles;
        l.solid += r.solid;
        return l;
      });
}

}  // namespace palpate::lab
