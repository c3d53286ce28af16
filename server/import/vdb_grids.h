// Which grid of a .vdb file is read.
//
// One thread. Errors: palpate::Error without the file's name.
#pragma once

#include <openvdb/Grid.h>

#include <filesystem>
#include <string>

namespace palpate {

// As the user asks for it; empty: the only one.
struct GridChoice {
  std::string name{};       // of the grid; NAME[K] is the K-th of several of one name
  std::string component{};  // of a grid of vectors: magnitude, x, y or z
};

// Of scalars: a float, double, int32, int64 or bool grid. kInvalidArgument for a file that is none,
// or a choice that is none: it lists what there is.
openvdb::GridBase::Ptr ReadChosenGrid(const std::filesystem::path& path, const GridChoice& choice);

}  // namespace palpate
