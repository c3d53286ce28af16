// Decomposes a cell into tetrahedra. The piecewise-linear level set of the tetrahedra is the haptic
// isosurface H. One function has four methods:
//
// kTpbcc, the default: H has the topology of the trilinear isosurface V for every
//   τ. Our correction of Corenthy et al., section 3.4.
// kBcc (section 3.2): face and cell centres, 24 tetrahedra. Neighbours agree, so
//   the proxy cannot fall through, but the topology of H may differ from V's.
// kTptd (section 3.3, after Sohn): corners and saddles only, 6 to 30 tetrahedra.
// kTpbccPublished (section 3.4 as printed, faults included): for six face saddles
//   tetrahedra may overlap, and for three or more the topology may be wrong.
// The last two are for comparison only. The proxy may fall through them.
//
// Each face is split into 4 triangles around its face vertex. kTptd splits a face without a saddle
// into 2 triangles. The split depends only on the 4 densities of the face, so neighbours have the
// same triangles, bit for bit.
//
// Frame: index coordinates local to the cell.
// Threads: pure functions. Real-time: no allocation, no locks; bounded.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "common/isosurface/cell.h"
#include "common/isosurface/complex.h"

namespace palpate {

enum class DecompositionMethod : std::uint8_t { kBcc, kTptd, kTpbccPublished, kTpbcc };

// The names in settings and command lines.
inline constexpr std::array<std::string_view, 4> kMethodNames = {"bcc", "tptd", "tpbcc-published",
                                                                 "tpbcc"};
inline constexpr int kMethodCount = static_cast<int>(kMethodNames.size());
constexpr std::string_view MethodName(DecompositionMethod method) {
  return kMethodNames[static_cast<std::size_t>(method)];
}
constexpr std::optional<DecompositionMethod> MethodNamed(std::string_view name) {
  for (std::size_t n = 0; n < kMethodNames.size(); ++n) {
    if (kMethodNames[n] == name) return static_cast<DecompositionMethod>(n);
  }
  return std::nullopt;
}

// True if the proxy can never fall through with this method.
constexpr bool IsSafe(DecompositionMethod method) {
  return method == DecompositionMethod::kBcc || method == DecompositionMethod::kTpbcc;
}

struct Decomposition {
  TetrahedralComplex complex;
  // Valid for the vertices in complex.used_vertices.
  std::array<Vec3, kMaxVertices> position;
  std::array<double, kMaxVertices> density;
  // For statistics: the counts that selected the case.
  int face_saddle_count = 0;
  int body_saddle_count = 0;
};

// `d` must be finite and without ties (ties.h).
Decomposition Decompose(const CellDensities& d, DecompositionMethod method);

}  // namespace palpate
