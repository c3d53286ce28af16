// palpate-lab cells: writes decompositions of single cells as JSON lines.
//
// Each input line holds 8 densities d0..d7, or the indices i, j, k of a cell if a volume is given.
// Commas or blanks separate the columns. Further columns are ignored, and lines that start with '#'
// are skipped.
// Ties are resolved as in a volume. Without a volume, they are resolved over the cell's own range,
// with the lattice index (0, 0, 0).
// Errors: Error (kInvalidArgument) with the line's number.
#pragma once

#include <istream>
#include <memory>
#include <ostream>

#include "server/lab/compared_method.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate::lab {

// Writes one line per cell:
// {"sigma_f":..,"sigma_c":..,"vertices":[[x,y,z,density],..],"tetrahedra":[..]}
// Without a volume, densities are in the units of the input. With a volume, they are normalised
// over its range, as in the renderer.
void DecomposeCells(std::istream& in, std::ostream& out, ComparedMethod method,
                    const VolumeSnapshot* volume);

}  // namespace palpate::lab
