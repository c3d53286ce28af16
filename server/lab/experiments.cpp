#include "server/lab/experiments.h"

#include <cstdarg>
#include <cstdio>

#include "common/error/error.h"
#include "server/lab/trajectory_file.h"

namespace palpate::lab {
namespace {

struct Experiment {
  const char* name;
  void (*run)(const ExperimentOptions&, std::ostream&);
  bool refines = false;  // has a use for --refine
  bool draws = false;    // NAME.svg
};

constexpr Experiment kExperiments[] = {
    {.name = "table1", .run = PrintTable1, .refines = true},
    {.name = "table3", .run = PrintTable3, .refines = true},
    {.name = "table4", .run = PrintTable4, .refines = true},
    {.name = "figure9", .run = PrintFigure9, .draws = true},
    {.name = "diamond", .run = PrintDiamond, .refines = true, .draws = true},
    {.name = "topology", .run = PrintTopology},
    {.name = "figure11", .run = PrintFigure11, .draws = true},
    {.name = "layers", .run = PrintLayers, .refines = true, .draws = true},
    {.name = "tool", .run = PrintTool, .refines = true}};

}  // namespace

CellDensities RandomCell(std::mt19937_64& random, bool alternating) {
  std::uniform_real_distribution<double> uniform;
  CellDensities d;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    d[v] = uniform(random);
    if (alternating) d[v] = 0.5 * (d[v] + (o[0] + o[1] + o[2]) % 2);
  }
  return d;
}

void Print(std::ostream& out, const char* format, ...) {
  char text[512];
  std::va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  out << text;
}

void WriteFigure(const ExperimentOptions& options, const char* name, const std::string& svg,
                 std::ostream& out) {
  const std::filesystem::path file = options.output_folder / name;
  WriteText(file, svg, ReplacesIf(options.overwrite));
  out << "figure " << file.string() << "\n";
}

std::vector<std::string> ExperimentNames() {
  std::vector<std::string> names;
  for (const Experiment& experiment : kExperiments) names.emplace_back(experiment.name);
  return names;
}

void RunExperiment(const ExperimentOptions& options, std::ostream& out) {
  if (options.columns < 1 || options.cells < 1 || options.laps < 1) {
    throw Error(ErrorKind::kInvalidArgument, "columns, cells and laps must be at least 1");
  }
  for (const Experiment& experiment : kExperiments) {
    if (options.name != experiment.name) continue;
    if (options.refinement != 1 && !experiment.refines) {
      throw Error(ErrorKind::kInvalidArgument, "--refine changes nothing in " + options.name);
    }
    if (experiment.draws) {
      CheckNewFile(options.output_folder / (options.name + ".svg"), ReplacesIf(options.overwrite));
    }
    experiment.run(options, out);
    return;
  }
  throw Error(ErrorKind::kInvalidArgument, "no experiment is called '" + options.name + "'");
}

}  // namespace palpate::lab
