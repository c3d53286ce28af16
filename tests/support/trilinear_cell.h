// The topology of V in one cell, without any decomposition.
//
// F is linear along each axis. So every point of {F > τ} climbs within it, along one axis after
// the other, to a corner of the cell; every point of {F < τ} sinks to one. The parts of either side
// are therefore sets of corners. What joins corners: an edge between them; on a face with
// alternating corners, the greater product of opposite corners; inside, a body saddle with two ways
// up (or down). No part has a hole, so surface and Euler characteristic follow from the counts of
// parts and of curves on the border.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <vector>

#include "server/lab/cell_topology.h"

namespace palpate::testing {

class TrilinearCell {
 public:
  // No two densities are equal.
  explicit TrilinearCell(const CellDensities& d) {
    for (int v = 0; v < 8; ++v) {
      const auto& o = kCornerOffset[v];
      d_[o[0] | o[1] << 1 | o[2] << 2] = d[v];
    }
    // F = a + Σ b_i x_i + Σ c_i x_j x_k + ρ x y z
    const auto& f = d_;
    b_ = {f[1] - f[0], f[2] - f[0], f[4] - f[0]};
    c_ = {f[6] - f[4] - b_[1], f[5] - f[4] - b_[0], f[3] - f[2] - b_[0]};
    rho_ = f[7] - f[6] - (f[5] - f[4]) - c_[2];
    FindBodySaddles();
  }

  // Of the saddles inside. Where no product x y z is in F, none is found.
  std::vector<double> BodySaddleDensities() const {
    std::vector<double> densities;
    for (int n = 0; n < saddle_count_; ++n) {
      densities.push_back(static_cast<double>(Value(saddle_[n])));
    }
    return densities;
  }

  lab::CellTopology At(double isovalue) const {
    unsigned above = 0;
    for (int v = 0; v < 8; ++v) above |= (d_[v] > isovalue ? 1u : 0u) << v;
    Parts up(above), down(~above & 0xFF);
    for (int v = 0; v < 8; ++v) {
      for (const int axis : {1, 2, 4}) up.Join(v, v ^ axis), down.Join(v, v ^ axis);
    }
    for (int axis = 0; axis < 3; ++axis) {
      for (const int side : {0, 1}) JoinOnFace(axis, side, isovalue, up, down);
    }
    const int curves = up.Count() + down.Count() - 1;
    for (int n = 0; n < saddle_count_; ++n) {
      const Point& p = saddle_[n];
      const bool is_up = Hessian(p, 0) * Hessian(p, 1) * Hessian(p, 2) > 0;
      if (is_up != (Value(p) > isovalue)) continue;
      (is_up ? up : down).Join(Climb(p, 0, is_up), Climb(p, 1, is_up));
    }
    const int surface = up.Count() + down.Count() - 1;
    return {up.Count(), down.Count(), surface, 2 * surface - curves};
  }

 private:
  using Real = long double;
  using Point = std::array<Real, 3>;

  // Parts of a set of corners.
  class Parts {
   public:
    explicit Parts(unsigned corners) {
      for (int v = 0; v < 8; ++v) part_[v] = corners >> v & 1 ? 1u << v : 0;
    }
    void Join(int u, int v) {
      const unsigned joined = part_[u] && part_[v] ? part_[u] | part_[v] : 0;
      for (int w = 0; w < 8; ++w) {
        if (joined >> w & 1) part_[w] = joined;
      }
    }
    int Count() const {
      int count = 0;
      for (int v = 0; v < 8; ++v) count += part_[v] && std::countr_zero(part_[v]) == v;
      return count;
    }

   private:
    std::array<unsigned, 8> part_;  // with the corner; 0: not in the set
  };

  void JoinOnFace(int axis, int side, double isovalue, Parts& up, Parts& down) const {
    const int b = 1 << (axis + 1) % 3, c = 1 << (axis + 2) % 3, o = side << axis;
    const std::array<int, 4> v = {o, o | b, o | b | c, o | c};
    const auto at = [&](int n) { return d_[v[n]] - isovalue; };
    for (int n = 1; n < 4; ++n) {
      if ((at(n) > 0) == (at(n - 1) > 0)) return;
    }
    const int n = at(0) * at(2) > at(1) * at(3) ? 0 : 1;
    (at(n) > 0 ? up : down).Join(v[n], v[n + 2]);
  }

  Real Value(const Point& p) const {
    const auto& [x, y, z] = p;
    return d_[0] + b_[0] * x + b_[1] * y + b_[2] * z + c_[0] * y * z + c_[1] * x * z +
           c_[2] * x * y + rho_ * x * y * z;
  }
  Real Slope(const Point& p, int axis) const {
    const int j = (axis + 1) % 3, k = (axis + 2) % 3;
    return b_[axis] + c_[k] * p[j] + c_[j] * p[k] + rho_ * p[j] * p[k];
  }
  // The second derivative along the two other axes.
  Real Hessian(const Point& p, int axis) const { return c_[axis] + rho_ * p[axis]; }

  // The corner that is reached from a saddle, first along x to `side`, then up or down.
  int Climb(Point p, int side, bool up) const {
    p[0] = side;
    for (const int axis : {1, 2}) p[axis] = (Slope(p, axis) > 0) == up ? 1 : 0;
    return static_cast<int>(p[0]) | static_cast<int>(p[1]) << 1 | static_cast<int>(p[2]) << 2;
  }

  // With its origin at -c / ρ, F = const + Σ s_i x_i + ρ x y z.
  void FindBodySaddles() {
    Point s;
    for (int i = 0; i < 3; ++i) s[i] = (b_[i] - c_[(i + 1) % 3] * c_[(i + 2) % 3] / rho_) / rho_;
    const Real square = -s[1] * s[2] / s[0];
    if (!(square > 0)) return;
    for (const Real x : {std::sqrt(square), -std::sqrt(square)}) {
      Point p = {x, -s[2] / x, -s[1] / x};
      bool inside = true;
      for (int i = 0; i < 3; ++i) {
        p[i] -= c_[i] / rho_;
        inside = inside && p[i] > 0 && p[i] < 1;
      }
      if (inside) saddle_[saddle_count_++] = p;
    }
  }

  std::array<Real, 8> d_;  // corner x + 2 y + 4 z
  Point b_, c_;
  Real rho_;
  int saddle_count_ = 0;
  std::array<Point, 2> saddle_;
};

}  // namespace palpate::testing
