// A cell: the unit cube between 8 lattice vertices, with their densities.
//
// Frame: index coordinates local to the cell, each in [0, 1]. Corners are
// numbered d0..d7 = 000 001 101 100 010 011 111 110 in (x, y, z).
// Faces are numbered 2 * axis + side: -x +x -y +y -z +z.
// Threads: pure functions. Real-time: no allocation, no locks.
// Source: Corenthy et al., section 3.1. The printed coefficients of xz and yz use the wrong
// corners; the coefficients here are right.
#pragma once

#include <array>
#include <cstdint>

#include "common/geometry/geometry.h"

namespace palpate {

// Densities at d0..d7, normalised over the volume's range.
using CellDensities = std::array<double, 8>;

inline constexpr std::array<std::array<int, 3>, 8> kCornerOffset = {
    {{0, 0, 0}, {0, 0, 1}, {1, 0, 1}, {1, 0, 0}, {0, 1, 0}, {0, 1, 1}, {1, 1, 1}, {1, 1, 0}}};

// Number of the corner at offset (x, y, z): kCornerAt[4 x + 2 y + z].
inline constexpr std::array<int, 8> kCornerAt = {0, 1, 4, 5, 3, 2, 7, 6};

constexpr int CornerAt(int x, int y, int z) { return kCornerAt[4 * x + 2 * y + z]; }

// Corners p, q, s, t of each face in cyclic order. With b < c as the face's two axes,
// in (b, c): p = (0,0), q = (1,0), s = (1,1), t = (0,1). The order depends only on the lattice
// axes. So the cells on both sides of a face compute the face vertex with the same bits.
constexpr std::array<std::array<int, 4>, 6> MakeFaceCorners() {
  std::array<std::array<int, 4>, 6> corners{};
  for (int face = 0; face < 6; ++face) {
    const int axis = face / 2;
    const int b = axis == 0 ? 1 : 0;
    const int c = axis == 2 ? 1 : 2;
    const int steps[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    for (int n = 0; n < 4; ++n) {
      int offset[3] = {0, 0, 0};
      offset[axis] = face % 2;
      offset[b] = steps[n][0];
      offset[c] = steps[n][1];
      corners[face][n] = CornerAt(offset[0], offset[1], offset[2]);
    }
  }
  return corners;
}
inline constexpr std::array<std::array<int, 4>, 6> kFaceCorners = MakeFaceCorners();

// True if the isosurface τ passes through the cell. Densities above τ are inside the object. All
// others, also those equal to τ, are free.
inline bool IsCrossed(const CellDensities& d, double isovalue) {
  int above = 0;
  for (double density : d) above += density > isovalue;
  return above != 0 && above != 8;
}

// The trilinear interpolant F = α + βx + γy + δz + εxy + ηxz + νyz + ρxyz.
struct Trilinear {
  double alpha, beta, gamma, delta, epsilon, eta, nu, rho;

  explicit Trilinear(const CellDensities& d)
      : alpha(d[0]),
        beta(d[3] - d[0]),
        gamma(d[4] - d[0]),
        delta(d[1] - d[0]),
        epsilon((d[7] - d[4]) - (d[3] - d[0])),
        eta((d[2] - d[1]) - (d[3] - d[0])),
        nu((d[5] - d[4]) - (d[1] - d[0])),
        rho(((d[6] - d[5]) - (d[7] - d[4])) - ((d[2] - d[1]) - (d[3] - d[0]))) {}

  double Value(const Vec3& p) const {
    const double x = p.x(), y = p.y(), z = p.z();
    return alpha + beta * x + gamma * y + delta * z + epsilon * x * y + eta * x * z + nu * y * z +
           rho * x * y * z;
  }

  // The gradient with respect to local index coordinates.
  Vec3 Gradient(const Vec3& p) const {
    const double x = p.x(), y = p.y(), z = p.z();
    return {beta + epsilon * y + eta * z + rho * y * z, gamma + epsilon * x + nu * z + rho * x * z,
            delta + eta * x + nu * y + rho * x * y};
  }
};

// Resolves ties between lattice densities by simulation of simplicity.
//
// Constant regions and 8-bit data tie corner values. A tie would leave H open or let neighbours
// disagree. So every lattice value is lowered by kTieStep * h(index), where h is a fixed hash into
// [1/4, 1). The decomposition, the proxy and the checks all do the same. Values are only lowered,
// so that a value equal to τ stays free space. The step is relative to the range of the whole
// volume, not of a cell, so that neighbours agree.
//
// Threads: pure functions. Real-time: no allocation, no locks.

// The largest lowering, as a fraction of the volume's range. Measured: 1e-6 changes the topology of
// real cells, 1e-8 does not.
inline constexpr double kTieStep = 1e-8;

// The density around the lattice of a level set: above every isovalue, however far it is lowered.
inline constexpr double kAboveAllIsovalues = 1.0 + 2.0 * kTieStep;

// Fixed hash of a lattice index into [1/4, 1). At least 1/4, so that a value equal to τ never
// rounds back to τ.
inline double TieHash(std::int32_t i, std::int32_t j, std::int32_t k) {
  std::uint64_t x = (static_cast<std::uint32_t>(i) + 1ull) * 0x9E3779B97F4A7C15ull;
  x ^= static_cast<std::uint32_t>(j) * 0xC2B2AE3D27D4EB4Full;
  x ^= static_cast<std::uint32_t>(k) * 0x165667B19E3779F9ull;
  // The finaliser of MurmurHash3 (public domain constants).
  x ^= x >> 33;
  x *= 0xFF51AFD7ED558CCDull;
  x ^= x >> 33;
  x *= 0xC4CEB9FE1A85EC53ull;
  x ^= x >> 33;
  return 0.25 + 0.75 * (static_cast<double>(x >> 11) * 0x1p-53);
}

// `density` is normalised over the volume's range.
inline double ResolvedDensity(double density, std::int32_t i, std::int32_t j, std::int32_t k) {
  return density - kTieStep * TieHash(i, j, k);
}

}  // namespace palpate
