#include "server/lab/compared_method.h"

namespace palpate::lab {

std::optional<ComparedMethod> MethodNamed(std::string_view name) {
  for (int n = 0; n < kMethodCount; ++n) {
    if (kMethodNames[n] == name) return static_cast<ComparedMethod>(n);
  }
  return std::nullopt;
}

Decomposition Decompose(const CellDensities& d, ComparedMethod method) {
  for (const auto felt : {DecompositionMethod::kBcc, DecompositionMethod::kTpbcc}) {
    if (method == Compared(felt)) return palpate::Decompose(d, felt);
  }
  Decomposition out;
  PlaceCorners(d, out);
  method == ComparedMethod::kTptd ? DecomposeTptd(d, out) : DecomposeTpbccPublished(d, out);
  return out;
}

}  // namespace palpate::lab
