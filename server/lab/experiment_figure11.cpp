// Fig. 11: the cells of Table 4 as an SVG sheet, with V beside H for each method.
#include <algorithm>
#include <cmath>
#include <sstream>

#include "server/lab/cell_view.h"
#include "server/lab/experiment_parts.h"
#include "server/lab/published_table.h"

namespace palpate::lab {
namespace {

const CellView kView{120};
constexpr int kSubdivision = 8;  // parts of a cell per axis, to draw V

struct Polygon {
  std::array<Vec3, 4> corner;
  int corners = 0;
};

// H within a tetrahedron: a triangle or a quadrilateral.
Polygon Cut(const Decomposition& cell, const std::array<std::uint8_t, 4>& v, double isovalue) {
  std::array<int, 4> above, below;
  int above_count = 0, below_count = 0;
  for (int vertex : v) {
    if (cell.density[vertex] > isovalue) {
      above[above_count++] = vertex;
    } else {
      below[below_count++] = vertex;
    }
  }
  Polygon polygon;
  const auto add = [&](int a, int b) {
    const double t = (isovalue - cell.density[a]) / (cell.density[b] - cell.density[a]);
    polygon.corner[polygon.corners++] =
        cell.position[a] + t * (cell.position[b] - cell.position[a]);
  };
  for (int a = 0; a < above_count; ++a) {
    // Goes round the quadrilateral, so the second row is in reverse order.
    for (int b = 0; b < below_count; ++b) {
      add(above[a], below[above_count == 2 && a == 1 ? below_count - 1 - b : b]);
    }
  }
  return polygon;
}

void AddSurface(const CellDensities& d, double isovalue, ComparedMethod method, const Vec3& origin,
                double edge, std::vector<Polygon>& polygons) {
  const Decomposition cell = Decompose(d, method);
  for (int t = 0; t < cell.complex.tetrahedron_count; ++t) {
    Polygon polygon = Cut(cell, cell.complex.vertices[t], isovalue);
    for (int n = 0; n < polygon.corners; ++n) {
      polygon.corner[n] = origin + edge * polygon.corner[n];
    }
    if (polygon.corners >= 3) polygons.push_back(polygon);
  }
}

std::vector<Polygon> VisualSurface(const CellDensities& d, double isovalue) {
  const Trilinear f(d);
  std::vector<Polygon> polygons;
  const double edge = 1.0 / kSubdivision;
  for (int n = 0; n < kSubdivision * kSubdivision * kSubdivision; ++n) {
    const Vec3 origin = edge * Vec3(n / (kSubdivision * kSubdivision),
                                    n / kSubdivision % kSubdivision, n % kSubdivision);
    CellDensities part;
    for (int v = 0; v < 8; ++v) {
      const auto& o = kCornerOffset[v];
      part[v] = f.Value(origin + edge * Vec3(o[0], o[1], o[2]));
    }
    if (IsCrossed(part, isovalue)) {
      AddSurface(part, isovalue, ComparedMethod::kTptd, origin, edge, polygons);
    }
  }
  return polygons;
}

// Draws from back to front, shaded by the angle between the normal and the eye.
void DrawSurface(std::vector<Polygon> polygons, bool outlined, std::ostream& svg) {
  const auto depth = [](const Polygon& p) {
    double sum = 0.0;
    for (int n = 0; n < p.corners; ++n) sum += kView.to_eye.dot(p.corner[n]);
    return sum / p.corners;
  };
  std::sort(polygons.begin(), polygons.end(),
            [&](const Polygon& a, const Polygon& b) { return depth(a) < depth(b); });
  for (const Polygon& polygon : polygons) {
    const Vec3 normal = (polygon.corner[1] - polygon.corner[0])
                            .cross(polygon.corner[2] - polygon.corner[0])
                            .normalized();
    const int light = static_cast<int>(80 + 150 * std::abs(normal.dot(kView.to_eye)));
    char colour[16];
    std::snprintf(colour, sizeof colour, "#%02x%02x%02x", outlined ? light : light * 3 / 4,
                  light * 7 / 8, outlined ? light * 3 / 5 : light);
    svg << "<path fill='" << colour << "' stroke='" << (outlined ? "#333" : colour)
        << "' stroke-width='0.4' d='";
    for (int n = 0; n < polygon.corners; ++n) {
      svg << (n == 0 ? "M" : "L") << kView.PixelX(polygon.corner[n]) << " "
          << kView.PixelY(polygon.corner[n]);
    }
    svg << "Z'/>\n";
  }
}

void DrawPanel(double x, double y, const std::string& label, const std::vector<Polygon>& polygons,
               bool outlined, std::ostream& svg) {
  svg << "<g transform='translate(" << x << " " << y << ")'>\n";
  DrawEdges(kView, svg);
  DrawSurface(polygons, outlined, svg);
  svg << "<text x='4' y='10'>" << label << "</text></g>\n";
}

}  // namespace

void PrintFigure11(const ExperimentOptions& options, std::ostream& out) {
  const std::vector<PublishedRow> rows = ReadPublishedTable(options.table);
  constexpr int kPanels = 1 + static_cast<int>(kMethodNames.size());
  const double width = kPanels * kView.panel,
               height = static_cast<double>(rows.size()) * kView.panel;
  std::ostringstream svg;
  svg.precision(5);
  svg << "<svg xmlns='http://www.w3.org/2000/svg' width='" << width << "' height='" << height
      << "' font-family='sans-serif' font-size='9'>\n<rect width='100%' height='100%' "
         "fill='white'/>\n";
  double y = 0.0;
  for (const PublishedRow& row : rows) {
    DrawPanel(0.0, y, "V " + row.name, VisualSurface(row.d, row.isovalue), false, svg);
    for (int m = 0; m + 1 < kPanels; ++m) {
      std::vector<Polygon> polygons;
      const auto method = static_cast<ComparedMethod>(m);
      AddSurface(DensitiesFor(row, method), row.isovalue, method, Vec3::Zero(), 1.0, polygons);
      DrawPanel((m + 1) * kView.panel, y, std::string(kMethodNames[m]), polygons, true, svg);
    }
    y += kView.panel;
  }
  svg << "</svg>\n";
  Print(out, "Fig. 11: V and H by %zu methods for %zu cells\n", kMethodNames.size(), rows.size());
  WriteFigure(options, "figure11.svg", svg.str(), out);
}

}  // namespace palpate::lab
