// The single experiments behind experiments.h.
#pragma once

#include <ostream>
#include <random>

#include "common/isosurface/cell.h"
#include "server/lab/experiments.h"

namespace palpate::lab {

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
