// Decomposes a cell into tetrahedra. The piecewise-linear level set of the tetrahedra is the haptic
// isosurface H. Two methods:
//
// kTpbcc, the default: H has the topology of the trilinear isosurface V for every
//   τ. Our correction of Corenthy et al., section 3.4.
// kBcc (section 3.2): face and cell centres, 24 tetrahedra. Neighbours agree, so
//   the proxy cannot fall through, but the topology of H may differ from V's.
//
// Each face is split into 4 triangles around its face vertex. The split depends only on the 4
// densities of the face, so neighbours have the same triangles, bit for bit.
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

enum class DecompositionMethod : std::uint8_t { kBcc, kTpbcc };

// The names in settings and command lines.
inline constexpr std::array<std::string_view, 2> kMethodNames = {"bcc", "tpbcc"};
constexpr std::string_view MethodName(DecompositionMethod method) {
  return kMethodNames[static_cast<std::size_t>(method)];
}
constexpr std::optional<DecompositionMethod> MethodNamed(std::string_view name) {
  for (std::size_t n = 0; n < kMethodNames.size(); ++n) {
    if (kMethodNames[n] == name) return static_cast<DecompositionMethod>(n);
  }
  return std::nullopt;
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
