// The diamond: what is inside of cells, how close H is to V with each method, and a picture.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "server/lab/accuracy.h"
#include "server/lab/cell_view.h"
#include "server/lab/experiments.h"
#include "server/lab/lab_arguments.h"

namespace palpate::lab {
namespace {

struct CellAt {
  CellDensities d;
  double isovalue;
};

// --- What is inside, and R_D

struct Tally {
  std::int64_t diagonal = 0, one_vertex = 0, two_vertices = 0;
  std::array<double, kMethodCount> difference{};  // sums of R_D
};

Tally TallyOf(const CellAt& cell, int refinement) {
  constexpr int kColumns = 20;  // enough for means over many cells
  Tally tally;
  const unsigned used = Decompose(cell.d, ComparedMethod::kTpbcc).complex.used_vertices;
  const unsigned interior = used >> kFirstInteriorVertex;
  ++(interior == 0 ? tally.diagonal : interior == 1 ? tally.one_vertex : tally.two_vertices);
  for (int m = 0; m < kMethodCount; ++m) {
    const auto method = static_cast<ComparedMethod>(m);
    tally.difference[m] = DifferenceOf(cell.d, cell.isovalue, method, kColumns,
                                       method == ComparedMethod::kTpbcc ? refinement : 1);
  }
  return tally;
}

void PrintTally(const char* name, const std::vector<CellAt>& cells, int refinement,
                std::ostream& out) {
  std::vector<Tally> tallies(cells.size());
  tbb::parallel_for(std::size_t{0}, cells.size(),
                    [&](std::size_t n) { tallies[n] = TallyOf(cells[n], refinement); });
  Tally sum;
  for (const Tally& tally : tallies) {
    sum.diagonal += tally.diagonal;
    sum.one_vertex += tally.one_vertex;
    sum.two_vertices += tally.two_vertices;
    for (int m = 0; m < kMethodCount; ++m) sum.difference[m] += tally.difference[m];
  }
  const double count = static_cast<double>(std::max<std::size_t>(cells.size(), 1));
  Print(out, "%-20s %8zu | %8.2f %8.2f %8.2f |", name, cells.size(), 100.0 * sum.diagonal / count,
        100.0 * sum.one_vertex / count, 100.0 * sum.two_vertices / count);
  for (const double difference : sum.difference) Print(out, " %15.3f", difference / count);
  out << std::endl;  // the next row takes seconds
}

// τ is uniform in [0.2, 0.8] and within the cell's range.
std::vector<CellAt> RandomCells(const ExperimentOptions& options, bool alternating) {
  std::mt19937_64 random(options.seed);
  std::uniform_real_distribution<double> uniform;
  std::vector<CellAt> cells;
  while (static_cast<std::int64_t>(cells.size()) < options.cells) {
    const CellDensities d = RandomCell(random, alternating);
    const CellAt cell{d, 0.2 + 0.6 * uniform(random)};
    if (IsCrossed(cell.d, cell.isovalue)) cells.push_back(cell);
  }
  return cells;
}

// Cells of a volume that τ crosses, spread evenly over all of them.
std::vector<CellAt> CrossedCells(const VolumeSnapshot& volume, double isovalue,
                                 std::int64_t count) {
  std::vector<CellAt> cells;
  const Vec3i end = volume.size() - Vec3i::Ones();
  for (int i = 0; i < end.x(); ++i) {
    for (int j = 0; j < end.y(); ++j) {
      for (int k = 0; k < end.z(); ++k) {
        const CellDensities d = volume.ResolvedCell(Vec3i(i, j, k));
        if (IsCrossed(d, isovalue)) cells.push_back({d, isovalue});
      }
    }
  }
  std::vector<CellAt> spread;
  const std::int64_t all = static_cast<std::int64_t>(cells.size());
  for (std::int64_t n = 0; n < std::min(count, all); ++n) {
    spread.push_back(cells[static_cast<std::size_t>(n * all / std::min(count, all))]);
  }
  return spread;
}

struct DiamondVolume {
  const char* name;
  const char* path;  // below the data folder
  double isovalue;   // normalised
};
constexpr DiamondVolume kDiamondVolumes[] = {
    {"tooth 0.42", "classic/tooth_103x94x161_uint8.nhdr", 0.42},
    {"lobster 0.16", "paper/lobster_301x324x56_uint8.nhdr", 0.16},
    {"daisy 0.24", "paper/daisy_192x180x168_uint8.nhdr", 0.24},
    {"CT head 0.33", "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", 0.33},
};

void PrintTallies(const ExperimentOptions& options, std::ostream& out) {
  Print(out,
        "Cells with a diagonal, one or two interior vertices, in %%; mean R_D in %% of the cell\n\n"
        "%-20s %8s | %8s %8s %8s |",
        "", "cells", "diagonal", "one", "two");
  for (std::string_view name : kMethodNames) Print(out, " %15s", name.data());
  out << "\n";
  PrintTally("uniform", RandomCells(options, false), options.refinement, out);
  PrintTally("alternating", RandomCells(options, true), options.refinement, out);
  for (const DiamondVolume& volume : kDiamondVolumes) {
    const auto path = options.data_folder / volume.path;
    if (!std::filesystem::exists(path)) {
      Print(out, "%-20s not found; give its folder with --data\n", volume.name);
      continue;
    }
    const auto loaded = LoadVolume(path.string(), ImportProgramBesideThis());
    PrintTally(volume.name, CrossedCells(*loaded, volume.isovalue, options.cells),
               options.refinement, out);
  }
}

// --- The picture

const CellView kDiamondView{220};

Vec3 VertexPosition(int v) {
  if (v < kFirstFaceVertex) return CornerPosition(v);
  Vec3 p = Vec3::Constant(0.5);
  const int face = v - kFirstFaceVertex;
  if (face < 6) p[face / 2] = face % 2;
  return p;
}

class Panel {
 public:
  Panel(int number, const char* title, std::ostream& svg) : svg_(svg) {
    svg << "<g transform='translate(" << number * kDiamondView.panel << " 0)'>\n";
    DrawEdges(kDiamondView, svg);
    svg << "<text x='6' y='16'>" << title << "</text>\n";
  }
  ~Panel() { svg_ << "</g>\n"; }

  void Fill(std::initializer_list<int> vertices, const char* colour) {
    svg_ << "<path fill='" << colour << "' fill-opacity='0.35' d='";
    AddPath(vertices);
    svg_ << "Z'/>\n";
  }
  void Line(int a, int b, const char* colour, double width, const char* dashes = "none") {
    svg_ << "<path fill='none' stroke='" << colour << "' stroke-width='" << width
         << "' stroke-dasharray='" << dashes << "' d='";
    AddPath({a, b});
    svg_ << "'/>\n";
  }
  void Name(int v, const char* name) {
    const Vec3 p = VertexPosition(v);
    svg_ << "<circle r='2.5' cx='" << kDiamondView.PixelX(p) << "' cy='" << kDiamondView.PixelY(p)
         << "'/><text x='" << kDiamondView.PixelX(p) + 5 << "' y='" << kDiamondView.PixelY(p) - 5
         << "'>" << name << "</text>\n";
  }

 private:
  void AddPath(std::initializer_list<int> vertices) {
    const char* step = "M";
    for (const int v : vertices) {
      const Vec3 p = VertexPosition(v);
      svg_ << step << kDiamondView.PixelX(p) << " " << kDiamondView.PixelY(p);
      step = "L";
    }
  }

  std::ostream& svg_;
};

constexpr const char* kOld = "#2c6fbb";
constexpr const char* kNew = "#d9730d";
constexpr int kO = kFirstInteriorVertex;

// The vertical edge next to the eye.
constexpr CubeEdge kNearEdge = [] {
  for (const CubeEdge& edge : kCubeEdges) {
    if (edge.u == CornerAt(1, 0, 1) && edge.v == CornerAt(1, 1, 1)) return edge;
  }
  return CubeEdge{};
}();

void DrawEdgeFlip(std::ostream& svg) {
  Panel panel(0, "1. at an edge", svg);
  const auto& [u, v, f, g] = kNearEdge;
  panel.Fill({kO, u, v}, kOld);
  for (const int corner : {u, v}) {
    for (const int other : {int{kO}, int{f}, int{g}}) panel.Line(corner, other, kOld, 1, "3 3");
  }
  panel.Line(kO, f, kOld, 1, "3 3");
  panel.Line(kO, g, kOld, 1, "3 3");
  panel.Line(f, g, kNew, 3);
  panel.Name(u, "u");
  panel.Name(v, "v");
  panel.Name(f, "f");
  panel.Name(g, "g");
  panel.Name(kO, "O");
}

void DrawCornerFlip(std::ostream& svg) {
  Panel panel(1, "2. at a corner", svg);
  const int corner = kNearEdge.v;
  const auto& [f, g, h] = kFacesAtCorner[corner];
  panel.Line(kO, corner, kOld, 2, "3 3");
  panel.Fill({f, g, h}, kNew);
  const int faces[] = {f, g, h};
  const char* names[] = {"f", "g", "h"};
  for (int n = 0; n < 3; ++n) {
    panel.Line(corner, faces[n], kOld, 1, "3 3");
    panel.Line(kO, faces[n], kOld, 1, "3 3");
    panel.Line(faces[n], faces[(n + 1) % 3], kNew, 2);
    panel.Name(faces[n], names[n]);
  }
  panel.Name(corner, "c");
  panel.Name(kO, "O");
}

void DrawDiamond(std::ostream& svg) {
  Panel panel(2, "3. the diamond", svg);
  for (int corner = 0; corner < 8; ++corner) {
    const auto& [f, g, h] = kFacesAtCorner[corner];
    if (kDiamondView.to_eye.dot(CornerPosition(corner) - Vec3::Constant(0.5)) > 0.0) {
      panel.Fill({f, g, h}, corner % 2 == 0 ? "#f0c48a" : "#e3a45c");
    }
  }
  for (const CubeEdge& edge : kCubeEdges) panel.Line(edge.f, edge.g, kNew, 1);
  panel.Line(kFirstFaceVertex + 2, kFirstFaceVertex + 3, "#b02020", 3);
  for (int face = 0; face < 6; ++face) panel.Name(kFirstFaceVertex + face, "");
}

std::string Picture() {
  std::ostringstream svg;
  svg.precision(5);
  svg << "<svg xmlns='http://www.w3.org/2000/svg' width='" << 3 * kDiamondView.panel << "' height='"
      << kDiamondView.panel << "' font-family='sans-serif' font-size='12'>\n<rect width='100%' "
      << "height='100%' fill='white'/>\n";
  DrawEdgeFlip(svg);
  DrawCornerFlip(svg);
  DrawDiamond(svg);
  svg << "</svg>\n";
  return svg.str();
}

}  // namespace

void PrintDiamond(const ExperimentOptions& options, std::ostream& out) {
  PrintTallies(options, out);
  WriteFigure(options, "diamond.svg", Picture(), out);
}

}  // namespace palpate::lab
