// Ways to decompose a cell that are compared with the two of the daemon (decomposition.h):
//
// kTptd (Corenthy et al., section 3.3, after Sohn): corners and saddles only, 6 to 30 tetrahedra.
//   A face without a saddle is split into 2 triangles.
// kTpbccPublished (section 3.4 as printed, faults included): for six face saddles tetrahedra may
//   overlap, and for three or more the topology may be wrong.
// The proxy may fall through both, so no hand feels them.
//
// Frame: index coordinates local to the cell. Threads: pure functions.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "common/isosurface/decomposition.h"
#include "common/isosurface/placement.h"

namespace palpate::lab {

enum class ComparedMethod : std::uint8_t { kBcc, kTptd, kTpbccPublished, kTpbcc };

// The names in command lines and tables.
inline constexpr std::array<std::string_view, 4> kMethodNames = {"bcc", "tptd", "tpbcc-published",
                                                                 "tpbcc"};
inline constexpr int kMethodCount = static_cast<int>(kMethodNames.size());
constexpr std::string_view NameOf(ComparedMethod method) {
  return kMethodNames[static_cast<std::size_t>(method)];
}
std::optional<ComparedMethod> MethodNamed(std::string_view name);
constexpr ComparedMethod Compared(DecompositionMethod method) {
  return method == DecompositionMethod::kBcc ? ComparedMethod::kBcc : ComparedMethod::kTpbcc;
}

// `d` must be finite and without ties (cell.h).
Decomposition Decompose(const CellDensities& d, ComparedMethod method);

}  // namespace palpate::lab
