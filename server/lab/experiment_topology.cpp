// Counts how often H has a wrong topology.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <mutex>
#include <random>

#include "common/isosurface/placement.h"
#include "server/lab/cell_topology.h"
#include "server/lab/compared_method.h"
#include "server/lab/experiments.h"

namespace palpate::lab {
namespace {

struct Case {
  int face_saddles, body_saddles;
  // True if the sorted face saddles pair up as parallel faces. Set only for cells with six face
  // saddles and a body saddle.
  bool pairs_up;
  auto operator<=>(const Case&) const = default;
};

struct Count {
  std::int64_t cells = 0;
  std::array<std::int64_t, kMethodCount> wrong{};
  std::array<std::int64_t, kMethodCount> not_filled{};

  void Add(const Count& other) {
    cells += other.cells;
    for (int m = 0; m < kMethodCount; ++m) {
      wrong[m] += other.wrong[m];
      not_filled[m] += other.not_filled[m];
    }
  }
};

using Counts = std::map<Case, Count>;

double SumOfVolumes(const Decomposition& cell) {
  double sum = 0.0;
  for (int t = 0; t < cell.complex.tetrahedron_count; ++t) {
    const auto& v = cell.complex.vertices[t];
    Mat3 edges;
    for (int n = 0; n < 3; ++n) edges.col(n) = cell.position[v[n + 1]] - cell.position[v[0]];
    sum += std::abs(edges.determinant()) / 6.0;
  }
  return sum;
}

// Returns one isovalue from every interval in which the topology of V is constant.
std::vector<double> IsovaluesOf(const CellDensities& d, const CellSaddles& saddles,
                                const BodySaddles& body) {
  std::vector<double> critical(d.begin(), d.end());
  for (const FaceSaddle& saddle : saddles.face) {
    if (saddle.exists) critical.push_back(saddle.density.value());
  }
  for (int n = 0; n < body.count; ++n) critical.push_back(body.saddle[n].density);
  std::sort(critical.begin(), critical.end());
  std::vector<double> isovalues;
  for (std::size_t n = 0; n + 1 < critical.size(); ++n) {
    isovalues.push_back(0.5 * (critical[n] + critical[n + 1]));
  }
  return isovalues;
}

Case CaseOf(const CellDensities& d, const CellSaddles& saddles, const BodySaddles& body) {
  Case c{saddles.count, body.count, true};
  if (saddles.count < 6 || body.count == 0) return c;
  const auto face = ClassifySaddles(d, saddles.face).face;
  for (int n = 0; n < 3; ++n) c.pairs_up &= (face[n] ^ 1) == face[5 - n];
  return c;
}

void CountCell(const CellDensities& d, Counts& counts) {
  const CellSaddles saddles(d);
  const BodySaddles body = FindBodySaddles(d);
  const std::vector<double> isovalues = IsovaluesOf(d, saddles, body);
  const Decomposition right = Decompose(d, ComparedMethod::kTpbcc);
  std::vector<CellTopology> expected;
  for (double isovalue : isovalues) expected.push_back(CountCellTopology(right, isovalue));
  Count& count = counts[CaseOf(d, saddles, body)];
  ++count.cells;
  for (int m = 0; m < kMethodCount; ++m) {
    const Decomposition cell = Decompose(d, static_cast<ComparedMethod>(m));
    bool wrong = false;
    for (std::size_t n = 0; n < isovalues.size() && !wrong; ++n) {
      wrong = !(CountCellTopology(cell, isovalues[n]) == expected[n]);
    }
    count.wrong[m] += wrong;
    count.not_filled[m] += std::abs(SumOfVolumes(cell) - 1.0) > 1e-9;
  }
}

// Each block has its own generator, so the cells are the same on any number of threads.
Counts CountCells(const ExperimentOptions& options, bool alternating) {
  constexpr std::int64_t kBlock = 500;
  Counts total;
  std::mutex mutex;
  const std::int64_t blocks = (options.cells + kBlock - 1) / kBlock;
  tbb::parallel_for(std::int64_t{0}, blocks, [&](std::int64_t block) {
    std::seed_seq seed{options.seed, static_cast<std::uint64_t>(block)};
    std::mt19937_64 random(seed);
    Counts counts;
    const std::int64_t end = std::min(options.cells - block * kBlock, kBlock);
    for (std::int64_t n = 0; n < end; ++n) CountCell(RandomCell(random, alternating), counts);
    const std::lock_guard lock(mutex);
    for (const auto& [c, count] : counts) total[c].Add(count);
  });
  return total;
}

void PrintCount(const std::string& name, const Count& count, std::ostream& out) {
  Print(out, "%-14s %9lld |", name.c_str(), static_cast<long long>(count.cells));
  const double percent = 100.0 / static_cast<double>(std::max<std::int64_t>(count.cells, 1));
  for (int m = 0; m < kMethodCount; ++m) {
    Print(out, " %7.2f %7.2f |", percent * static_cast<double>(count.wrong[m]),
          percent * static_cast<double>(count.not_filled[m]));
  }
  out << "\n";
}

void PrintCounts(const char* title, const Counts& counts, std::ostream& out) {
  Print(out, "\n%s\n%-14s %9s |", title, "sf sc", "cells");
  for (std::string_view name : kMethodNames) Print(out, " %15.15s |", name.data());
  out << "\n";
  Count all;
  for (const auto& [c, count] : counts) {
    std::string name = std::to_string(c.face_saddles) + "  " + std::to_string(c.body_saddles);
    if (c.face_saddles == 6 && c.body_saddles > 0) name += c.pairs_up ? " paired" : " unpaired";
    PrintCount(name, count, out);
    all.Add(count);
  }
  PrintCount("all", all, out);
}

}  // namespace

void PrintTopology(const ExperimentOptions& options, std::ostream& out) {
  Print(out,
        "Cells with a wrong topology for some isovalue, and cells whose tetrahedra overlap or\n"
        "leave gaps, in %% of the cells. Every interval between critical densities is tried.\n"
        "The components of both sides and of H, and the Euler characteristic, are compared with\n"
        "the results of tpbcc. tpbcc has no fault on any of the 37 000 cells labelled by an exact\n"
        "oracle. For six face saddles and a body saddle, the published rules need sorted faces\n"
        "that pair up as parallel faces.\n");
  PrintCounts("uniform: corners in [0, 1]", CountCells(options, false), out);
  PrintCounts("alternating: odd corners in [0.5, 1], the others in [0, 0.5]",
              CountCells(options, true), out);
}

}  // namespace palpate::lab
