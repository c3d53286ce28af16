// Writes a mesh as PLY (binary, little-endian) or OBJ, by the file's ending.
//
// Frame of the files: W, world (mm, LPS as in DICOM). Coordinates keep double
// precision: in single precision vertices beside a lattice vertex would coincide.
// Threads: any ordinary thread; blocks. Errors: Error.
#pragma once

#include <filesystem>

#include "common/geometry/geometry.h"
#include "server/lab/mesh.h"

namespace palpate::lab {

// kInvalidArgument unless the ending is .ply or .obj, in either case of letters:
// to be asked before the work is done.
void CheckMeshFileName(const std::filesystem::path& path);

// Writes beside `path` and renames, so that `path` is either whole or as it was.
// X_WI: world from index; where it mirrors, the triangles are turned over.
// kInvalidArgument (ending), kUnavailable (cannot write, disk full).
void WriteMesh(const SurfaceMesh& mesh, const AffineMap& X_WI, const std::filesystem::path& path);

}  // namespace palpate::lab
