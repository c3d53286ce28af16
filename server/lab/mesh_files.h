// Writes a mesh as PLY (binary, little-endian) or OBJ, as the file's ending tells.
//
// Frame of the files: W, world (mm, LPS as in DICOM). Coordinates keep double precision: in single
// precision, vertices next to a lattice vertex would coincide.
// Threads: any ordinary thread; blocks. Errors: Error. Apart for its tests.
#pragma once

#include <filesystem>

#include "common/files/new_file.h"
#include "common/geometry/geometry.h"
#include "server/lab/mesh.h"

namespace palpate::lab {

// Throws kInvalidArgument unless the ending is .ply or .obj, in upper or lower case. Call it before
// the long work.
void CheckMeshFileName(const std::filesystem::path& path);

// Writes a new file beside `path` and renames it, so `path` is either complete or unchanged. X_WI:
// world from index. If X_WI mirrors, the order of each triangle's vertices is reversed. Throws
// kInvalidArgument (ending), and what NewFile throws.
void WriteMesh(const SurfaceMesh& mesh, const AffineMap& X_WI, const std::filesystem::path& path,
               IfThere if_there);

}  // namespace palpate::lab
