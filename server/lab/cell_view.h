// Draws a cell into an SVG: an orthographic view from above one corner, x to the lower right, y up,
// z to the left.
//
// Frame: index coordinates local to the cell; pixels of a square panel.
// Threads: pure functions.
#pragma once

#include <ostream>

#include "common/isosurface/decomposition.h"

namespace palpate::lab {

struct CellView {
  double panel;  // its width, in pixels
  Vec3 rightward = Vec3(0.87, 0.0, -0.5).normalized();
  Vec3 to_eye = Vec3(0.45, 0.42, 0.79).normalized();
  Vec3 upward = to_eye.cross(rightward).normalized();

  double PixelX(const Vec3& p) const { return panel / 2 + Scale(rightward, p); }
  double PixelY(const Vec3& p) const { return panel / 2 - Scale(upward, p); }

 private:
  double Scale(const Vec3& axis, const Vec3& p) const {
    return 0.52 * panel * axis.dot(p - Vec3::Constant(0.5));
  }
};

inline Vec3 CornerPosition(int corner) {
  const auto& o = kCornerOffset[corner];
  return Vec3(o[0], o[1], o[2]);
}

inline void DrawEdges(const CellView& view, std::ostream& svg) {
  svg << "<path stroke='#999' stroke-width='0.7' fill='none' d='";
  for (const CubeEdge& edge : kCubeEdges) {
    const Vec3 a = CornerPosition(edge.u), b = CornerPosition(edge.v);
    svg << "M" << view.PixelX(a) << " " << view.PixelY(a) << "L" << view.PixelX(b) << " "
        << view.PixelY(b);
  }
  svg << "'/>\n";
}

}  // namespace palpate::lab
