// Rows of the paper's Table 4.
//
// Errors: Error. Apart for its tests.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "server/lab/compared_method.h"

namespace palpate::lab {

struct PublishedRow {
  std::string name;  // name of the case, such as 13.5.1
  double isovalue;
  CellDensities d;         // as printed: the published methods got these densities
  CellDensities resolved;  // ties resolved: kTpbcc needs these densities
  // R_D in % of the cell for kBcc, kTptd and kTpbccPublished; empty if unreadable in the paper.
  std::array<std::optional<double>, 3> difference;
};

// The densities to give to the method.
inline const CellDensities& DensitiesFor(const PublishedRow& row, ComparedMethod method) {
  return method == ComparedMethod::kTpbcc ? row.resolved : row.d;
}

// Reads CSV: name, τ, d0..d7, and the three figures or blanks. Further columns are ignored, lines
// that start with '#' are skipped. Throws kNotFound, kInvalidArgument.
std::vector<PublishedRow> ReadPublishedTable(const std::filesystem::path& file);

// True if our R_D is close to the published one: within 0.15 or 2 %. For kTptd, whose rules the
// paper leaves open: within 0.3.
bool MeetsPublished(ComparedMethod method, double published, double ours);

}  // namespace palpate::lab
