// Chooses the grid of a .vdb file to read.
//
// Threads: one. Errors: palpate::Error without the file's name.
#pragma once

#include <filesystem>
#include <string>

#include "server/volume/snapshot/openvdb_grids.h"

namespace palpate {

// The user's choice. Empty: the only grid.
struct GridChoice {
  std::string name{};       // the grid's; NAME[K] is the K-th of several grids with this name
  std::string component{};  // for a grid of vectors: magnitude, x, y or z
};

// Returns a grid of scalars: float, double, int32, int64 or bool. Throws kInvalidArgument if the
// file is no .vdb file, or if the choice does not exist; the message then lists the choices.
openvdb::GridBase::Ptr ReadChosenGrid(const std::filesystem::path& path, const GridChoice& choice);

}  // namespace palpate
