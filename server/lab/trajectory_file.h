// Reads and writes trajectories of the HIP as CSV: one position per row and tick, in mm, in the
// volume's world frame.
//
// The header names the columns: x_mm, y_mm, z_mm, or hip_x, hip_y, hip_z, the names in a replay's
// output. Other columns are ignored. Numbers may be nan or inf: a device may send them, and a
// replay shows how the renderer handles them.
// Threads: any ordinary thread. Errors: Error.
#pragma once

#include <filesystem>
#include <vector>

#include "common/files/new_file.h"
#include "common/geometry/geometry.h"

namespace palpate::lab {

// Throws kNotFound; kInvalidArgument with the line's number, also if there is no row.
std::vector<Vec3> ReadTrajectory(const std::filesystem::path& file);

// Both write the complete file or nothing. Throw the errors of NewFile.
void WriteTrajectory(const std::filesystem::path& file, const std::vector<Vec3>& hips_mm,
                     IfThere if_there);
void WriteText(const std::filesystem::path& file, const std::string& text, IfThere if_there);

}  // namespace palpate::lab
