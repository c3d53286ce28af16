// Rows of the paper's Table 4.
//
// Errors: Error.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/isosurface/decomposition.h"

namespace palpate::lab {

struct PublishedRow {
  std::string name;  // of the case, such as 13.5.1
  double isovalue;
  CellDensities d;         // as printed: what the published methods were given
  CellDensities resolved;  // ties resolved: what kTpbcc asks for
  // R_D in % of the cell by kBcc, kTptd and kTpbccPublished, where readable.
  std::array<std::optional<double>, 3> difference;
};

// The densities that the method is to be given.
inline const CellDensities& DensitiesFor(const PublishedRow& row, DecompositionMethod method) {
  return method == DecompositionMethod::kTpbcc ? row.resolved : row.d;
}

// CSV: name, τ, d0..d7, and the three figures or blanks; further columns are
// ignored, lines that start with '#' skipped. kNotFound, kInvalidArgument.
std::vector<PublishedRow> ReadPublishedTable(const std::filesystem::path& file);

// Whether ours meets the published figure: within 0.15 or 2 %, for kTptd, whose
// rules the paper leaves open, within 0.3.
bool MeetsPublished(DecompositionMethod method, double published, double ours);

}  // namespace palpate::lab
