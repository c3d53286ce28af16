// Trajectories of the HIP as CSV: one position a row and tick, mm, in the volume's
// world frame.
//
// The header names the columns: x_mm, y_mm, z_mm, or hip_x, hip_y, hip_z as replays
// write them; others are ignored. Numbers may be nan or inf: a device may send such,
// and what the renderer does with them is to be seen.
// Threads: any ordinary thread. Errors: Error.
#pragma once

#include <filesystem>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate::lab {

// kNotFound; kInvalidArgument with the line's number, and where there is no row.
std::vector<Vec3> ReadTrajectory(const std::filesystem::path& file);

// Whole or not at all. kUnavailable.
void WriteTrajectory(const std::filesystem::path& file, const std::vector<Vec3>& hips_mm);

// For a look before long work: kNotFound where there is no folder to write to,
// kInvalidArgument where `file` is something else than a file.
void CheckOutputFile(const std::filesystem::path& file);

// Whole or not at all. kUnavailable.
void WriteText(const std::filesystem::path& file, const std::string& text);

}  // namespace palpate::lab
