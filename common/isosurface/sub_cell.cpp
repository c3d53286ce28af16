#include "common/isosurface/sub_cell.h"

namespace palpate {
namespace {

// The corners at both ends of the edges along each axis.
constexpr auto kEdgesAlong = [] {
  std::array<std::array<std::array<int, 2>, 4>, 3> edges{};
  for (int axis = 0; axis < 3; ++axis) {
    for (int v = 0, n = 0; v < 8; ++v) {
      auto o = kCornerOffset[v];
      if (o[axis] == 1) continue;
      o[axis] = 1;
      edges[axis][n++] = {v, CornerAt(o[0], o[1], o[2])};
    }
  }
  return edges;
}();

// Keeps the part of the cell between `step` and the next one of `refinement` steps along an axis.
template <int kAxis>
void CutAlong(CellDensities& d, int step, int refinement) {
  constexpr auto& kEdges = kEdgesAlong[kAxis];
  if (refinement == 3) {
    for (const auto& [low, high] : kEdges) {
      const double a = d[low], b = d[high];
      const double first = ((a + a) + b) / 3.0, second = (a + (b + b)) / 3.0;
      if (step > 0) d[low] = step == 1 ? first : second;
      if (step < 2) d[high] = step == 0 ? first : second;
    }
    return;
  }
  // A quarter is the half of a half.
  for (int half = refinement / 2; half > 0; half /= 2) {
    if (step & half) {
      for (const auto& [low, high] : kEdges) d[low] = 0.5 * (d[low] + d[high]);
    } else {
      for (const auto& [low, high] : kEdges) d[high] = 0.5 * (d[low] + d[high]);
    }
  }
}

}  // namespace

CellDensities SubCell(const CellDensities& d, const Vec3i& sub, int refinement) {
  CellDensities out = d;
  CutAlong<0>(out, sub.x(), refinement);
  CutAlong<1>(out, sub.y(), refinement);
  CutAlong<2>(out, sub.z(), refinement);
  return out;
}

}  // namespace palpate
