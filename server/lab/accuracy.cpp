#include "server/lab/accuracy.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>

namespace palpate::lab {
namespace {

// The value at (x, y) as a linear function of x and y, and the slope along z.
struct Linear {
  double constant, x, y, z;
  double At(double px, double py) const { return constant + x * px + y * py; }
};

struct Tetrahedron {
  std::array<Linear, 4> barycentric;
  Linear density;
};

struct Span {
  double low, high;
};

// The part of a column within a tetrahedron, and the density there.
struct Piece {
  Span span;
  double density_at_zero, slope;
};

struct Pieces {
  int count = 0;
  std::array<Piece, kMaxTetrahedra> piece;
};

struct Tetrahedra {
  int count = 0;
  std::array<Tetrahedron, kMaxTetrahedra> list;

  explicit Tetrahedra(const Decomposition& cell);
};

Tetrahedra::Tetrahedra(const Decomposition& cell) {
  constexpr double kFlat = 1e-14;
  for (int t = 0; t < cell.complex.tetrahedron_count; ++t) {
    const auto& v = cell.complex.vertices[t];
    const Vec3 origin = cell.position[v[0]];
    Mat3 edges;
    for (int n = 0; n < 3; ++n) edges.col(n) = cell.position[v[n + 1]] - origin;
    if (std::abs(edges.determinant()) < kFlat) continue;
    const Mat3 rows = edges.inverse();
    Tetrahedron& out = list[count++];
    out.density = {};
    for (int n = 0; n < 4; ++n) {
      const Vec3 g =
          n == 0 ? Vec3(-rows.colwise().sum().transpose()) : Vec3(rows.row(n - 1).transpose());
      const Linear theta{(n == 0 ? 1.0 : 0.0) - g.dot(origin), g.x(), g.y(), g.z()};
      const double density = cell.density[v[n]];
      out.barycentric[n] = theta;
      out.density.constant += density * theta.constant;
      out.density.x += density * theta.x;
      out.density.y += density * theta.y;
      out.density.z += density * theta.z;
    }
  }
}

// Returns an empty span (low >= high) if the column misses the tetrahedron.
Span Inside(const Tetrahedron& tetrahedron, double x, double y) {
  Span span{0.0, 1.0};
  for (const Linear& theta : tetrahedron.barycentric) {
    const double value = theta.At(x, y);
    if (theta.z > 0.0) {
      span.low = std::max(span.low, -value / theta.z);
    } else if (theta.z < 0.0) {
      span.high = std::min(span.high, -value / theta.z);
    } else if (value < 0.0) {
      return {1.0, 0.0};
    }
  }
  return span;
}

// The part of [0, 1] where a + b z is above τ.
Span Above(double a, double b, double isovalue) {
  const bool at_zero = a > isovalue, at_one = a + b > isovalue;
  const double crossing = (isovalue - a) / b;
  if (at_zero) return {0.0, at_one ? 1.0 : crossing};
  return {at_one ? crossing : 1.0, 1.0};
}

bool Holds(const Span& span, double z) { return span.low < z && z < span.high; }

// Adds one column, of unit area.
void AddColumn(const Tetrahedra& tetrahedra, const Trilinear& f, double isovalue, double x,
               double y, Accuracy& sum) {
  const double bottom = f.Value({x, y, 0.0});
  const Span solid = Above(bottom, f.Value({x, y, 1.0}) - bottom, isovalue);
  // Nothing changes between two neighbouring borders.
  std::array<double, 4 + 3 * kMaxTetrahedra> border{0.0, 1.0, solid.low, solid.high};
  int borders = 4;
  Pieces pieces;
  for (int t = 0; t < tetrahedra.count; ++t) {
    const Tetrahedron& tetrahedron = tetrahedra.list[t];
    const Span span = Inside(tetrahedron, x, y);
    if (!(span.low < span.high)) continue;
    const Piece piece{span, tetrahedron.density.At(x, y), tetrahedron.density.z};
    pieces.piece[pieces.count++] = piece;
    border[borders++] = span.low;
    border[borders++] = span.high;
    const double crossing = (isovalue - piece.density_at_zero) / piece.slope;
    if (Holds(span, crossing)) border[borders++] = crossing;
  }
  std::sort(border.begin(), border.begin() + borders);
  // Shorter stretches are due to rounding at shared triangles.
  constexpr double kShortest = 1e-12;
  for (int n = 0; n + 1 < borders; ++n) {
    const double length = border[n + 1] - border[n];
    if (length < kShortest) continue;
    const double z = 0.5 * (border[n] + border[n + 1]);
    int holders = 0;
    bool above = true;  // a gap counts as inside
    for (int p = 0; p < pieces.count; ++p) {
      const Piece& piece = pieces.piece[p];
      if (!Holds(piece.span, z)) continue;
      if (holders++ == 0) above = piece.density_at_zero + piece.slope * z > isovalue;
    }
    if (above != Holds(solid, z)) sum.difference += length;
    if (holders > 1) sum.overlap += (holders - 1) * length;
    if (holders == 0) sum.gap += length;
  }
}

}  // namespace

Accuracy MeasureAccuracy(const CellDensities& d, double isovalue, const Decomposition& cell,
                         int columns) {
  const Tetrahedra tetrahedra(cell);
  const Trilinear f(d);
  // Samples slightly off the middles: then no column lies within a triangle that is parallel to z.
  constexpr double kOffX = 0.5137, kOffY = 0.4929;
  const auto add_rows = [&](const tbb::blocked_range<int>& rows, Accuracy sum) {
    for (int i = rows.begin(); i < rows.end(); ++i) {
      for (int j = 0; j < columns; ++j) {
        AddColumn(tetrahedra, f, isovalue, (i + kOffX) / columns, (j + kOffY) / columns, sum);
      }
    }
    return sum;
  };
  const auto join = [](const Accuracy& a, const Accuracy& b) {
    return Accuracy{a.difference + b.difference, a.overlap + b.overlap, a.gap + b.gap};
  };
  constexpr int kRowsPerTask = 32;
  Accuracy sum = tbb::parallel_deterministic_reduce(
      tbb::blocked_range<int>(0, columns, kRowsPerTask), Accuracy{}, add_rows, join);
  const double percent = 100.0 / (static_cast<double>(columns) * columns);
  return {sum.difference * percent, sum.overlap * percent, sum.gap * percent};
}

double DifferenceOf(const CellDensities& d, double isovalue, ComparedMethod method, int columns,
                    int refinement) {
  // As many columns over the whole cell, rounded up.
  const int columns_in_part = (columns + refinement - 1) / refinement;
  double sum = 0.0;
  for (int x = 0; x < refinement; ++x) {
    for (int y = 0; y < refinement; ++y) {
      for (int z = 0; z < refinement; ++z) {
        const CellDensities part = SubCell(d, Vec3i(x, y, z), refinement);
        if (refinement > 1 && !IsCrossed(part, isovalue)) continue;
        sum += MeasureAccuracy(part, isovalue, Decompose(part, method), columns_in_part).difference;
      }
    }
  }
  return sum / (refinement * refinement * refinement);
}

}  // namespace palpate::lab
