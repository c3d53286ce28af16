// palpate-lab experiment: repeats the paper's measurements and prints its results beside ours.
//
//   table1    means of R_D over the cells of Table 4, Wilcoxon tests between methods
//   table3    time of a haptic update while a hand explores the paper's volumes
//   table4    R_D of every cell, published and ours, with differences marked
//   topology  share of random cells in which H has a wrong topology for some τ
//   diamond   what is inside of cells, mean R_D on random cells and on volumes, and a picture
//   figure9   drift of the proxy from a cylinder's isovalue, ours and a GBID
//   figure11  V and H drawn for the cells of Table 4
//   layers    a stylus presses through skin to the bone of a CT head
//   tool      rigid tools on a gyroid and a CT head: times, falls, rests, energy
//
// Threads: any ordinary thread; works on all cores. Errors: Error.
// Source: Corenthy et al., section 5, Tables 1, 3 and 4, Figs. 9 and 11.
#pragma once

#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <ostream>
#include <random>
#include <string>
#include <vector>

#include "common/isosurface/cell.h"

namespace palpate::lab {

struct ExperimentOptions {
  std::string name;                         // one of ExperimentNames()
  std::filesystem::path table;              // Table 4 as CSV, for table1, table4 and figure11
  std::int64_t cells = 20000;               // for topology and diamond: cells of each kind;
                                            // for tool: ticks of each run
  int refinement = 1;                       // of tpbcc; not for figures and topology
  int columns = 1000;                       // per axis, for R_D (accuracy.h)
  int laps = 10;                            // for figure9
  std::uint64_t seed = 1;                   // for topology, diamond, table3, tool
  std::filesystem::path data_folder = ".";  // for table3, diamond, layers, tool: holds the volumes
  std::filesystem::path output_folder = ".";  // for figures: NAME.svg
  bool overwrite = false;                     // of figures
};

std::vector<std::string> ExperimentNames();

// Prints a table. Writes figures to files and prints the files' names. Throws kInvalidArgument for
// an unknown name, kNotFound for files that cannot be read or written.
void RunExperiment(const ExperimentOptions& options, std::ostream& out);

// The single experiments.

void PrintTable1(const ExperimentOptions& options, std::ostream& out);
void PrintTable3(const ExperimentOptions& options, std::ostream& out);
void PrintTable4(const ExperimentOptions& options, std::ostream& out);
void PrintDiamond(const ExperimentOptions& options, std::ostream& out);
void PrintTopology(const ExperimentOptions& options, std::ostream& out);
void PrintFigure9(const ExperimentOptions& options, std::ostream& out);
void PrintFigure11(const ExperimentOptions& options, std::ostream& out);
void PrintLayers(const ExperimentOptions& options, std::ostream& out);
void PrintTool(const ExperimentOptions& options, std::ostream& out);

// Corners are uniform in [0, 1]. `alternating`: corners are halved, and ½ is added to the odd
// corners.
CellDensities RandomCell(std::mt19937_64& random, bool alternating);

// Throws Error if the text cannot be written.
void WriteFigure(const ExperimentOptions& options, const char* name, const std::string& svg,
                 std::ostream& out);

// printf into a stream, for tables.
[[gnu::format(printf, 2, 3)]] void Print(std::ostream& out, const char* format, ...);

}  // namespace palpate::lab
