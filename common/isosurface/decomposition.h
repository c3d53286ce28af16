// Decomposition of a cell into tetrahedra, whose piecewise-linear level set is
// the haptic isosurface H. Four methods behind one function:
//
// kTpbcc, the default: H has the topology of the trilinear isosurface V for every
//   τ. Our correction of Corenthy et al., section 3.4.
// kBcc (section 3.2): face and cell centres, 24 tetrahedra. Neighbours agree, so
//   that the proxy cannot fall through, but the topology of H may differ from V's.
// kTptd (section 3.3, after Sohn): corners and saddles only, 6 to 30 tetrahedra.
// kTpbccPublished (section 3.4 as printed, faults included): for six face saddles
//   tetrahedra may overlap, and for three or more the topology may be wrong.
// The last two are for comparison: no promise about the proxy is made for them.
//
// Each face is split into 4 triangles around its face vertex (kTptd: into 2 where
// it has no saddle), which depend on the 4 densities of the face alone, so that
// neighbours share them bit for bit.
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

// As settings and command lines name them.
inline constexpr std::array<std::string_view, 4> kMethodNames = {"bcc", "tptd", "tpbcc-published",
                                                                 "tpbcc"};
constexpr std::string_view MethodName(DecompositionMethod method) {
  return kMethodNames[static_cast<std::size_t>(method)];
}
constexpr std::optional<DecompositionMethod> MethodNamed(std::string_view name) {
  for (std::size_t n = 0; n < kMethodNames.size(); ++n) {
    if (kMethodNames[n] == name) return static_cast<DecompositionMethod>(n);
  }
  return std::nullopt;
}

// Whether the proxy is promised never to fall through with this method.
constexpr bool IsSafe(DecompositionMethod method) {
  return method == DecompositionMethod::kBcc || method == DecompositionMethod::kTpbcc;
}

struct Decomposition {
  TetrahedralComplex complex;
  // Valid for complex.used_vertices.
  std::array<Vec3, kMaxVertices> position;
  std::array<double, kMaxVertices> density;
  // What decided, for statistics.
  int face_saddle_count = 0;
  int body_saddle_count = 0;
};

// `d` resolved (ties.h) and finite.
Decomposition Decompose(const CellDensities& d, DecompositionMethod method);

}  // namespace palpate
