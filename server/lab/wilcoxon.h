// Wilcoxon's signed-rank test of paired samples, two-sided.
//
// Pairs without a difference are left out. Equal differences share their mean rank. Up to 25 pairs
// without equal differences, the p-value is exact. Otherwise it is the normal approximation with
// the variance corrected for ties.
//
// Threads: pure function.
// Source: F. Wilcoxon, Individual comparisons by ranking methods (1945); used in Corenthy et al.,
// Table 1. Apart for its tests.
#pragma once

#include <span>

namespace palpate::lab {

struct SignedRankResult {
  int pairs = 0;         // pairs with a difference
  double w_plus = 0.0;   // sum of the ranks of the pairs in which the first is larger
  double w_minus = 0.0;  // sum of the ranks of the other pairs
  double p_value = 1.0;
  bool exact = false;
};

// Both must have the same number of values.
SignedRankResult SignedRankTest(std::span<const double> first, std::span<const double> second);

}  // namespace palpate::lab
