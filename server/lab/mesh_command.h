// palpate-lab mesh: counts and writes the whole haptic isosurface of a volume.
//
// Threads: the calling one; works on all cores. Errors: Error.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "server/lab/load_volume.h"

namespace palpate::lab {

struct MeshOptions {
  std::string volume;  // a path, or a builtin name
  // Give exactly one: in data units, or 0 to 1 over the volume's range.
  std::optional<double> isovalue{};
  std::optional<double> normalized_isovalue{};
  std::string method = "tpbcc";  // one of kMethodNames
  int refinement = 1;
  std::filesystem::path output;  // .ply or .obj; empty: no file, only counts
  bool overwrite = false;        // of `output`
  std::filesystem::path import_program = ImportProgramBesideThis();
};

// Prints one "name value" per line on standard output. Shows a progress bar on standard error if
// that is a terminal. Returns the exit status, 0.
int RunMesh(const MeshOptions& options);

}  // namespace palpate::lab
