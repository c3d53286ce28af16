#include "common/isosurface/saddles.h"

#include <algorithm>
#include <cmath>
#include <span>

namespace palpate {
namespace {

// A gradient below this share of the cell's largest coefficient counts as zero. True saddles are
// refined to 1e-15; false ones had 0.4.
constexpr double kZeroGradient = 1e-7;

// Sets of corners are bit masks. The corners 0 to 3 form a ring, the corners 4 to 7 another, and
// the corners n and n + 4 share an edge.
unsigned WithNeighbours(unsigned corners) {
  const unsigned next = (corners << 1 & 0xEE) | (corners >> 3 & 0x11);
  const unsigned previous = (corners >> 1 & 0x77) | (corners << 3 & 0x88);
  const unsigned across = (corners << 4 | corners >> 4) & 0xFF;
  return corners | next | previous | across;
}

// The two corners of the saddle's face that are below the saddle.
unsigned LowCorners(const FaceSaddle& saddle, int face) {
  const auto& corners = kFaceCorners[face];
  const int first = saddle.p_and_s_low ? 0 : 1;
  return 1u << corners[first] | 1u << corners[first + 2];
}

// Returns the corners connected to `component`, corners below `level`. Two things connect corners:
// a cube edge joins two corners below `level`, and so does each face saddle below it.
unsigned LowComponent(const CellDensities& d, std::span<const unsigned> joined,
                      const SplitDensity& level, unsigned component) {
  unsigned low = 0;
  for (int corner = 0; corner < 8; ++corner) {
    if (SplitDensity{d[corner], 0.0} < level) low |= 1u << corner;
  }
  for (unsigned before = 0; component != before;) {
    before = component;
    component |= WithNeighbours(component) & low;
    for (const unsigned pair : joined) {
      if (component & pair) component |= pair;
    }
  }
  return component;
}

}  // namespace

FaceSaddle FindFaceSaddle(double p, double q, double s, double t) {
  FaceSaddle saddle;
  const double pq = p - q, pt = p - t, sq = s - q, st = s - t;
  // (p-t)(s-q) > 0 and (p-q)(s-t) > 0, computed by signs: products could underflow.
  const bool up = pq > 0 && pt > 0 && sq > 0 && st > 0;
  const bool down = pq < 0 && pt < 0 && sq < 0 && st < 0;
  if (!up && !down) return saddle;
  const double delta = pq + st;  // p + s - q - t; both terms have the same sign
  saddle.exists = true;
  saddle.p_and_s_low = down;
  saddle.b = pt / delta;
  saddle.c = pq / delta;
  // The distance to each corner: s - p = -(p-q)(p-t)/Δ, and likewise for the other corners.
  const SplitDensity from[4] = {{p, -pq * (pt / delta)},
                                {q, pq * (sq / delta)},
                                {s, -sq * (st / delta)},
                                {t, pt * (st / delta)}};
  saddle.density = *std::min_element(from, from + 4, [](const auto& l, const auto& r) {
    return std::abs(l.offset) < std::abs(r.offset);
  });
  return saddle;
}

BodySaddles FindBodySaddles(const CellDensities& d) {
  Trilinear f(d);
  // Scale to order one, so that the products below neither overflow nor underflow.
  const double scale =
      std::max({std::abs(f.beta), std::abs(f.gamma), std::abs(f.delta), std::abs(f.epsilon),
                std::abs(f.eta), std::abs(f.nu), std::abs(f.rho)});
  BodySaddles found;
  if (!(scale > 0.0)) return found;
  const Trilinear original = f;
  for (double* k : {&f.beta, &f.gamma, &f.delta, &f.epsilon, &f.eta, &f.nu, &f.rho}) *k /= scale;

  // Eliminating y and z from ∇F = 0 leaves a quadratic in x.
  const double big_b = f.beta * f.rho - f.epsilon * f.eta;
  const double a2 = f.rho * big_b;
  const double a1 = f.nu * big_b;  // half of the linear coefficient
  const double a0 = f.nu * f.nu * f.beta + f.gamma * f.delta * f.rho -
                    f.nu * (f.gamma * f.eta + f.delta * f.epsilon);
  // a1² - a2 a0. As a product it keeps its sign where two saddles are close to each other.
  const double discriminant =
      -big_b * (f.gamma * f.rho - f.epsilon * f.nu) * (f.delta * f.rho - f.eta * f.nu);
  if (discriminant < 0.0) return found;
  const double root = std::copysign(std::sqrt(discriminant), a1), q = -(a1 + root);
  // a0 / q would lose the difference of two roots that are close to each other.
  const bool close = std::abs(root) < 0.5 * std::abs(a1);
  const double roots[2] = {q / a2, close ? (root - a1) / a2 : a0 / q};
  for (double x : roots) {
    const double denominator = f.nu + f.rho * x;
    Vec3 p(x, -(f.delta + f.eta * x) / denominator, -(f.gamma + f.epsilon * x) / denominator);
    if (!p.allFinite()) continue;
    for (int step = 0; step < 2; ++step) {
      const double xy = f.epsilon + f.rho * p.z();
      const double xz = f.eta + f.rho * p.y();
      const double yz = f.nu + f.rho * p.x();
      // The inverse of the Hessian, which is symmetric with a zero diagonal, by cofactors.
      const double det = 2.0 * xy * xz * yz;
      Mat3 adjugate;
      adjugate << -yz * yz, xz * yz, xy * yz, xz * yz, -xz * xz, xy * xz, xy * yz, xy * xz,
          -xy * xy;
      const Vec3 next = p - adjugate * f.Gradient(p) / det;
      if (!next.allFinite()) break;
      p = next;
    }
    // Between nearly tied densities, rounding can produce a root that does not exist.
    if (!(f.Gradient(p).cwiseAbs().maxCoeff() <= kZeroGradient)) continue;
    if ((p.array() > 0.0).all() && (p.array() < 1.0).all()) {
      if (found.count == 1 && found.saddle[0].position == p) continue;  // a double root
      found.saddle[found.count++] = {p, original.Value(p)};
    }
  }
  return found;
}

SaddlePattern ClassifySaddles(const CellDensities& d, const std::array<FaceSaddle, 6>& saddles) {
  SaddlePattern pattern;
  for (int face = 0; face < 6; ++face) {
    if (!saddles[face].exists) continue;
    int n = pattern.count++;
    // Insertion sort keeps equal saddles in the order of their faces.
    while (n > 0 && saddles[face].density < saddles[pattern.face[n - 1]].density) {
      pattern.face[n] = pattern.face[n - 1];
      --n;
    }
    pattern.face[n] = static_cast<std::uint8_t>(face);
  }
  std::array<unsigned, 6> low_corners{};
  for (int n = 0; n < pattern.count; ++n) {
    const int face = pattern.face[n];
    const unsigned low = low_corners[n] = LowCorners(saddles[face], face);
    const unsigned component =
        LowComponent(d, std::span(low_corners).first(n), saddles[face].density, low & -low);
    // The corners are already in one component: the saddle closes a loop and cuts the region above.
    pattern.splitting[n] = (component & low) == low;
  }
  return pattern;
}

}  // namespace palpate
