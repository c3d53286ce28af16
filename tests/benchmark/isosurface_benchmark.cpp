// Cost of classifying and decomposing a cell that τ crosses, per method and number
// of face saddles. "smooth": a random gradient plus 15 % noise, like most cells of
// real volumes; "uniform": independent corners.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <random>
#include <vector>

#include "common/isosurface/placement.h"

namespace palpate {
namespace {

constexpr std::size_t kCells = 4096;

CellDensities UniformCell(std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform;
  CellDensities d;
  for (double& x : d) x = uniform(random);
  return d;
}

CellDensities SmoothCell(std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const Vec3 gradient(uniform(random), uniform(random), uniform(random));
  CellDensities d;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    d[v] = gradient.dot(Vec3(o[0], o[1], o[2])) + 0.15 * uniform(random);
  }
  return d;
}

// `saddles` < 0: any number.
std::vector<CellDensities> UniformCells(int saddles) {
  std::mt19937_64 random(11);
  std::vector<CellDensities> cells;
  while (cells.size() < kCells) {
    const CellDensities d = UniformCell(random);
    if (saddles < 0 || CellSaddles(d).count == saddles) cells.push_back(d);
  }
  return cells;
}

void Run(benchmark::State& state, const std::vector<CellDensities>& cells,
         DecompositionMethod method) {
  std::size_t n = 0;
  for (auto _ : state) {
    const CellDensities& d = cells[n++ % kCells];
    if (!IsCrossed(d, 0.5 * (d[0] + d[6]))) continue;
    benchmark::DoNotOptimize(Decompose(d, method));
  }
}

void Smooth(benchmark::State& state, DecompositionMethod method) {
  std::mt19937_64 random(12);
  std::vector<CellDensities> cells(kCells);
  for (CellDensities& d : cells) d = SmoothCell(random);
  Run(state, cells, method);
}

void Uniform(benchmark::State& state, DecompositionMethod method, int saddles) {
  Run(state, UniformCells(saddles), method);
}

BENCHMARK_CAPTURE(Smooth, tpbcc, DecompositionMethod::kTpbcc);
BENCHMARK_CAPTURE(Smooth, bcc, DecompositionMethod::kBcc);
BENCHMARK_CAPTURE(Smooth, tptd, DecompositionMethod::kTptd);
BENCHMARK_CAPTURE(Smooth, tpbcc_published, DecompositionMethod::kTpbccPublished);
BENCHMARK_CAPTURE(Uniform, tpbcc_0_saddles, DecompositionMethod::kTpbcc, 0);
BENCHMARK_CAPTURE(Uniform, tpbcc_1_saddle, DecompositionMethod::kTpbcc, 1);
BENCHMARK_CAPTURE(Uniform, tpbcc_2_saddles, DecompositionMethod::kTpbcc, 2);
BENCHMARK_CAPTURE(Uniform, tpbcc_3_saddles, DecompositionMethod::kTpbcc, 3);
BENCHMARK_CAPTURE(Uniform, tpbcc_4_saddles, DecompositionMethod::kTpbcc, 4);
BENCHMARK_CAPTURE(Uniform, tpbcc_6_saddles, DecompositionMethod::kTpbcc, 6);

// Where τ does not pass, nothing is decomposed.
void NotCrossed(benchmark::State& state) {
  const std::vector<CellDensities> cells = UniformCells(-1);
  std::size_t n = 0;
  for (auto _ : state) benchmark::DoNotOptimize(IsCrossed(cells[n++ % kCells], 2.0));
}
BENCHMARK(NotCrossed);

}  // namespace
}  // namespace palpate

BENCHMARK_MAIN();
