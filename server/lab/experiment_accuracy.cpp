// Tables 1 and 4: R_D of the four methods.
#include <algorithm>

#include "server/lab/accuracy.h"
#include "server/lab/experiment_parts.h"
#include "server/lab/published_table.h"
#include "server/lab/wilcoxon.h"

namespace palpate::lab {
namespace {

struct Measured {
  std::vector<PublishedRow> rows;
  std::array<std::vector<double>, kMethodCount> difference;  // per method and row
};

Measured Measure(const ExperimentOptions& options) {
  Measured measured{ReadPublishedTable(options.table), {}};
  for (const PublishedRow& row : measured.rows) {
    for (int m = 0; m < kMethodCount; ++m) {
      const auto method = static_cast<ComparedMethod>(m);
      measured.difference[m].push_back(
          DifferenceOf(DensitiesFor(row, method), row.isovalue, method, options.columns,
                       method == ComparedMethod::kTpbcc ? options.refinement : 1));
    }
  }
  return measured;
}

double Mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (double value : values) sum += value;
  return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
}

}  // namespace

void PrintTable4(const ExperimentOptions& options, std::ostream& out) {
  const Measured measured = Measure(options);
  Print(out,
        "Table 4: R_D in %% of the cell, %d x %d columns; published, then ours.\n"
        "* differs by more than 0.15 and 2 %%, tptd by more than 0.3\n\n"
        "case     tau   |   bcc           |  tptd           |  tpbcc-published |  tpbcc\n",
        options.columns, options.columns);
  std::array<int, 3> met{}, given{};
  for (std::size_t r = 0; r < measured.rows.size(); ++r) {
    const PublishedRow& row = measured.rows[r];
    Print(out, "%-8s %.2f  |", row.name.c_str(), row.isovalue);
    for (int m = 0; m < 3; ++m) {
      const double ours = measured.difference[m][r];
      if (!row.difference[m]) {
        Print(out, "     -  %6.2f   |", ours);
        continue;
      }
      const bool meets = MeetsPublished(static_cast<ComparedMethod>(m), *row.difference[m], ours);
      ++given[m];
      met[m] += meets;
      Print(out, " %6.2f %6.2f %c |", *row.difference[m], ours, meets ? ' ' : '*');
    }
    Print(out, "   %6.2f\n", measured.difference[3][r]);
  }
  Print(out, "\nmet: bcc %d of %d, tptd %d of %d, tpbcc-published %d of %d\n", met[0], given[0],
        met[1], given[1], met[2], given[2]);
  int best = 0;
  for (std::size_t r = 0; r < measured.rows.size(); ++r) {
    const auto& all = measured.difference;
    best += all[3][r] < std::min({all[0][r], all[1][r], all[2][r]});
  }
  Print(out, "tpbcc, cells cut into %d^3: the least of all in %d of %zu, mean %.3f\n",
        options.refinement, best, measured.rows.size(), Mean(measured.difference[3]));
}

void PrintTable1(const ExperimentOptions& options, std::ostream& out) {
  const Measured measured = Measure(options);
  Print(out, "Table 1: mean R_D in %% of the cell over %zu cells\n\n%-16s %8s %22s %10s\n",
        measured.rows.size(), "method", "ours", "ours, published rows", "published");
  for (int m = 0; m < kMethodCount; ++m) {
    Print(out, "%-16s %8.3f", kMethodNames[m].data(), Mean(measured.difference[m]));
    // Compares only the rows for which the paper has a figure.
    std::vector<double> published, ours;
    for (std::size_t n = 0; n < measured.rows.size(); ++n) {
      const PublishedRow& row = measured.rows[n];
      if (m >= 3 || !row.difference[m]) continue;
      published.push_back(*row.difference[m]);
      ours.push_back(measured.difference[m][n]);
    }
    if (m < 3) {
      Print(out, " %22.3f %10.3f (%zu)", Mean(ours), Mean(published), published.size());
    }
    out << "\n";
  }
  Print(out, "\nWilcoxon's signed-rank test, two-sided: W+ where the first has the larger R_D\n");
  for (int a = 0; a < kMethodCount; ++a) {
    for (int b = a + 1; b < kMethodCount; ++b) {
      const SignedRankResult test = SignedRankTest(measured.difference[a], measured.difference[b]);
      Print(out, "%-16s %-16s pairs %2d  W+ %6.1f  W- %6.1f  p %.4f%s\n", kMethodNames[a].data(),
            kMethodNames[b].data(), test.pairs, test.w_plus, test.w_minus, test.p_value,
            test.exact ? " (exact)" : "");
    }
  }
}

}  // namespace palpate::lab
