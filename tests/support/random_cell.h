// Random cells of many kinds.
#pragma once

#include <array>
#include <cmath>
#include <random>
#include <span>

#include "common/isosurface/cell.h"

namespace palpate::testing {

enum class CellKind {
  kUniform,
  kAlternating,
  kSmooth,
  kHeavyTailed,
  kFourLevels,  // tied, with ties resolved
  kTwoLevels,
  kTiedAlternating,
  // For what must hold on any input. Rounding decides the topology of these.
  kNearTied,
  kHugeRange,
  kSubnormal,
};
inline constexpr std::array kCellKinds = {CellKind::kUniform,         CellKind::kAlternating,
                                          CellKind::kSmooth,          CellKind::kHeavyTailed,
                                          CellKind::kFourLevels,      CellKind::kTwoLevels,
                                          CellKind::kTiedAlternating, CellKind::kNearTied,
                                          CellKind::kHugeRange,       CellKind::kSubnormal};
inline constexpr std::span kExactCells = std::span(kCellKinds).first<7>();

inline CellDensities RandomCell(CellKind kind, std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform;
  const Vec3 slope(uniform(random), uniform(random), uniform(random));
  CellDensities d;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    const int odd = (o[0] + o[1] + o[2]) % 2;
    const double u = uniform(random), tie = kTieStep * uniform(random);
    const int level = static_cast<int>(4.0 * u);
    switch (kind) {
      case CellKind::kUniform:
        d[v] = u;
        break;
      case CellKind::kAlternating:
        d[v] = 0.5 * (u + odd);
        break;
      case CellKind::kSmooth:
        d[v] = slope.dot(Vec3(o[0], o[1], o[2])) + 0.5 * u;
        break;
      case CellKind::kHeavyTailed:
        d[v] = std::pow(u, 8.0);
        break;
      case CellKind::kFourLevels:
        d[v] = level / 3.0 + tie;
        break;
      case CellKind::kTwoLevels:
        d[v] = level / 2 + tie;
        break;
      case CellKind::kTiedAlternating:
        d[v] = odd + tie;
        break;
      case CellKind::kNearTied:
        d[v] = level / 3.0 + 1e-7 * tie;
        break;
      case CellKind::kHugeRange:
        d[v] = std::ldexp(u - 0.5, static_cast<int>(random() % 4) * 300);
        break;
      case CellKind::kSubnormal:
        d[v] = std::ldexp(u, -1060);
        break;
    }
  }
  return d;
}

}  // namespace palpate::testing
