#include "server/lab/wilcoxon.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace palpate::lab {
namespace {

constexpr int kMostExactPairs = 25;

// The share of the 2^n equally likely sign patterns whose positive ranks sum to at most `sum`.
double LowerTail(int n, int sum) {
  std::vector<double> ways(n * (n + 1) / 2 + 1, 0.0);
  ways[0] = 1.0;
  for (int rank = 1; rank <= n; ++rank) {
    for (int s = static_cast<int>(ways.size()) - 1; s >= rank; --s) ways[s] += ways[s - rank];
  }
  double below = 0.0;
  for (int s = 0; s <= sum; ++s) below += ways[s];
  return std::ldexp(below, -n);
}

}  // namespace

SignedRankResult SignedRankTest(std::span<const double> first, std::span<const double> second) {
  std::vector<double> differences;
  for (std::size_t n = 0; n < first.size(); ++n) {
    if (first[n] != second[n]) differences.push_back(first[n] - second[n]);
  }
  std::sort(differences.begin(), differences.end(),
            [](double a, double b) { return std::abs(a) < std::abs(b); });
  SignedRankResult result;
  const std::size_t count = differences.size();
  result.pairs = static_cast<int>(count);
  if (count == 0) return result;
  double ties = 0.0;  // sum of t³ - t over all groups of t equal differences
  for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
    while (end < count && std::abs(differences[end]) == std::abs(differences[begin])) ++end;
    const double size = static_cast<double>(end - begin);
    const double rank = 0.5 * static_cast<double>(begin + 1 + end);
    ties += size * size * size - size;
    for (std::size_t n = begin; n < end; ++n) {
      (differences[n] > 0.0 ? result.w_plus : result.w_minus) += rank;
    }
  }
  const double smaller = std::min(result.w_plus, result.w_minus);
  result.exact = result.pairs <= kMostExactPairs && ties == 0.0;
  if (result.exact) {
    result.p_value = std::min(1.0, 2.0 * LowerTail(result.pairs, static_cast<int>(smaller)));
    return result;
  }
  const double n = result.pairs;
  const double variance = n * (n + 1.0) * (2.0 * n + 1.0) / 24.0 - ties / 48.0;
  const double z = (n * (n + 1.0) / 4.0 - smaller) / std::sqrt(variance);
  result.p_value = std::min(1.0, std::erfc(z / std::numbers::sqrt2));
  return result;
}

}  // namespace palpate::lab
