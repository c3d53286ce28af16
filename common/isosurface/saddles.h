// Face and body saddles of the trilinear interpolant in a cell.
//
// Frame: index coordinates local to the cell. Densities must be free of exact
// ties (ties.h).
// Threads: pure functions. Real-time: no allocation, no locks.
// Source: Corenthy et al., section 3.1, Eqs. 3-7; body saddles by a quadratic
// that stays accurate for any ρ instead of Eq. 7.
#pragma once

#include <array>
#include <cstdint>

#include "common/isosurface/cell.h"

namespace palpate {

// A density kept as one of the cell's corner values plus an offset. A saddle
// close to a corner has that corner's value to rounding; compared this way the
// two keep their order.
struct SplitDensity {
  double base;
  double offset;

  double value() const { return base + offset; }
  friend bool operator<(const SplitDensity& a, const SplitDensity& b) {
    return (a.base - b.base) + (a.offset - b.offset) < 0.0;
  }
};

// Stationary point of the bilinear interpolant on a face.
struct FaceSaddle {
  bool exists = false;       // strictly inside the face
  bool p_and_s_low = false;  // corners p and s are below it, q and t above; or the reverse
  double b = 0.5;            // along p -> q
  double c = 0.5;            // along p -> t
  SplitDensity density{0.0, 0.0};
};

FaceSaddle FindFaceSaddle(double p, double q, double s, double t);

struct BodySaddle {
  Vec3 position;
  double density;
};

struct BodySaddles {
  int count = 0;  // 0, 1 or 2
  std::array<BodySaddle, 2> saddle;
};

// Zeros of ∇F strictly inside the cell.
BodySaddles FindBodySaddles(const CellDensities& d);

// How the face saddles, sorted by density, change the level sets on the
// cell's boundary: joining, where two components of {F < value} meet, or
// splitting, where a component of {F > value} separates.
struct SaddlePattern {
  int count = 0;                     // face saddles
  std::array<std::uint8_t, 6> face;  // faces in ascending order of density
  std::array<bool, 6> splitting;     // likewise; false: joining

  // JJSJSS: two interior vertices are needed (only six saddles can do this).
  bool IsInterleavedSix() const {
    return count == 6 && !splitting[0] && !splitting[1] && splitting[2] && !splitting[3] &&
           splitting[4] && splitting[5];
  }
};

SaddlePattern ClassifySaddles(const CellDensities& d, const std::array<FaceSaddle, 6>& saddles);

}  // namespace palpate
