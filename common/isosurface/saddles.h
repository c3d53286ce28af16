// Face and body saddles of the trilinear interpolant in a cell.
//
// Frame: index coordinates local to the cell. Densities must be free of exact
// ties (cell.h).
// Threads: pure functions. Real-time: no allocation, no locks.
// Source: Corenthy et al., section 3.1, Eqs. 3-7. Body saddles do not use Eq. 7, but a quadratic
// that stays accurate for any ρ.
#pragma once

#include <array>
#include <cstdint>

#include "common/isosurface/cell.h"

namespace palpate {

// A density, stored as a corner value of the cell plus an offset. A saddle close to a corner rounds
// to the corner's value. With the offset, the order of the two is kept.
struct SplitDensity {
  double base;
  double offset;

  double value() const { return base + offset; }
  friend bool operator<(const SplitDensity& a, const SplitDensity& b) {
    return (a.base - b.base) + (a.offset - b.offset) < 0.0;
  }
};

// The stationary point of the bilinear interpolant on a face.
struct FaceSaddle {
  bool exists = false;  // strictly inside the face
  // True: p and s are below the saddle, q and t above. False: the reverse.
  bool p_and_s_low = false;
  double b = 0.5;  // along p -> q
  double c = 0.5;  // along p -> t
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

// Finds the zeros of ∇F strictly inside the cell.
BodySaddles FindBodySaddles(const CellDensities& d);

// How the face saddles, sorted by density, change the level sets on the cell's boundary. At a
// joining saddle two components of {F < value} meet. At a splitting saddle a component of {F >
// value} separates.
struct SaddlePattern {
  int count = 0;                     // face saddles
  std::array<std::uint8_t, 6> face;  // faces in ascending order of density
  std::array<bool, 6> splitting;     // likewise; false: joining

  // True for JJSJSS, which needs two interior vertices. Only six saddles can have this order.
  bool IsInterleavedSix() const {
    return count == 6 && !splitting[0] && !splitting[1] && splitting[2] && !splitting[3] &&
           splitting[4] && splitting[5];
  }
};

SaddlePattern ClassifySaddles(const CellDensities& d, const std::array<FaceSaddle, 6>& saddles);

}  // namespace palpate
