// palpate-lab experiment: the paper's measurements repeated, its figures beside ours.
//
//   table1    means of R_D over the cells of Table 4, Wilcoxon tests between methods
//   table3    time of a haptic update while a hand explores the paper's volumes
//   table4    R_D of every cell, published and ours, differences flagged
//   topology  share of random cells in which H has a wrong topology for some τ
//   figure9   drift of the proxy off a cylinder's isovalue, ours and a GBID
//   figure11  the cells of Table 4 with V and H drawn
//
// Threads: any ordinary thread; works on all cores. Errors: Error.
// Source: Corenthy et al., section 5, Tables 1, 3 and 4, Figs. 9 and 11.
#pragma once

#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

namespace palpate::lab {

struct ExperimentOptions {
  std::string name;                         // ExperimentNames()
  std::filesystem::path table;              // Table 4 as CSV; the cells of table1, table4, figure11
  std::int64_t cells = 20000;               // of topology: random ones of each kind
  int columns = 1000;                       // per axis, for R_D (accuracy.h)
  int laps = 10;                            // of figure9
  std::uint64_t seed = 1;                   // of topology and table3
  std::filesystem::path data_folder = ".";  // of table3: holds the volumes
  std::filesystem::path output_folder = ".";  // of figures: NAME.svg
};

std::vector<std::string> ExperimentNames();

// Prints a table; figures go to files, whose names it prints. kInvalidArgument for
// a name that is none, kNotFound for files that cannot be read or written.
void RunExperiment(const ExperimentOptions& options, std::ostream& out);

}  // namespace palpate::lab
