// palpate-lab cells: decompositions of single cells as JSON lines.
//
// Each input line holds 8 densities d0..d7 (or, with a volume, a cell's i, j, k),
// separated by commas or blanks; further columns are ignored, lines that start
// with '#' skipped. Ties are resolved as in a volume: over the cell's own range
// without a volume, whose lattice index is then (0, 0, 0).
// Errors: Error (kInvalidArgument) with the line's number.
#pragma once

#include <istream>
#include <memory>
#include <ostream>

#include "common/isosurface/decomposition.h"
#include "server/volume/snapshot.h"

namespace palpate::lab {

// {"sigma_f":..,"sigma_c":..,"vertices":[[x,y,z,density],..],"tetrahedra":[..]},
// a line per cell. Densities are in the units of the input; with a volume
// normalised over its range, as the renderer has them.
void DecomposeCells(std::istream& in, std::ostream& out, DecompositionMethod method,
                    const VolumeSnapshot* volume);

}  // namespace palpate::lab
