// Cells that the proxy visited lately, with their decompositions.
//
// A cache only: what it returns depends on the surface and the cell alone.
// Threads: one (the servo's). Real-time: no allocation, no locks; fixed size.
#pragma once

#include <array>
#include <cstdint>

#include "server/haptics/haptic_surface.h"

namespace palpate {

struct HapticCell {
  Vec3i cell = Vec3i::Zero();
  CellDensities densities{};  // felt, ties resolved
  double min_density = 0.0;
  double max_density = 0.0;
  Decomposition parts;                       // valid once `decomposed`
  std::array<Vec3, kMaxVertices> vertex_mm;  // likewise; D axes, relative to d0
  bool decomposed = false;

  bool IsCrossed(double isovalue) const {
    return min_density <= isovalue && isovalue < max_density;
  }
  bool IsFree(double isovalue) const { return max_density <= isovalue; }
};

class CellCache {
 public:
  // Densities only. The reference is valid until the next call for a cell that
  // shares its slot: copy what has to last.
  HapticCell& Densities(const HapticSurface& surface, const Vec3i& cell) noexcept;
  // With the decomposition.
  const HapticCell& Decomposed(const HapticSurface& surface, const Vec3i& cell) noexcept;

 private:
  static constexpr std::size_t kSlots = 128;
  static constexpr std::uint64_t kEmpty = ~std::uint64_t{0};

  std::uint64_t geometry_revision_ = kEmpty;
  FreeSide free_side_ = FreeSide::kBelow;
  std::array<std::uint64_t, kSlots> filled_{};  // generation_ when the slot was filled
  std::uint64_t generation_ = 0;
  std::array<HapticCell, kSlots> cells_;
};

}  // namespace palpate
