// Resolves ties between lattice densities by simulation of simplicity.
//
// Constant regions and 8-bit data tie corner values. A tie would leave H open or let neighbours
// disagree. So every lattice value is lowered by kTieStep * h(index), where h is a fixed hash into
// [1/4, 1). The decomposition, the proxy and the checks all do the same. Values are only lowered,
// so that a value equal to τ stays free space. The step is relative to the range of the whole
// volume, not of a cell, so that neighbours agree.
//
// Threads: pure functions. Real-time: no allocation, no locks.
#pragma once

#include <cstdint>

namespace palpate {

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
