// Stores the last place of each volume, and where patients face, in a TOML file.
//
// Frames and units as in registration.h. Threads: any; not for real-time code.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate {

// The place of one volume. The source names the volume: a path, a builtin or an upload. A different
// size or spacing means a different volume.
struct StoredRegistration {
  std::string source;
  Vec3i size = Vec3i::Zero();
  Vec3 spacing_mm = Vec3::Ones();
  Vec3 p_DCenter_mm = Vec3::Zero();
  Eigen::Quaterniond R_DW = Eigen::Quaterniond::Identity();
  double device_mm_per_volume_mm = 1.0;
};

// What somebody answered for a volume whose file states no orientation.
struct StoredAxes {
  std::string voxels;        // names the voxels and their directions in W, wherever they come from
  std::string patient_axes;  // as IsAnsweredAxes allows
};

struct RegistrationFile {
  std::vector<StoredRegistration> entries;  // oldest first
  std::vector<StoredAxes> axes;             // oldest first
  std::string damage;                       // what could not be read, one line; empty: no damage
};

// Returns no entries if there is no such file. Leaves out damaged entries and reports them in
// `damage`.
RegistrationFile ReadRegistrations(const std::filesystem::path& path);

// Afterwards the file is either complete or unchanged. Makes the folder if it is missing. Leaves
// out sources that a TOML file cannot hold (a path need not be UTF-8). Throws Error (kUnavailable).
void WriteRegistrations(const std::filesystem::path& path,
                        const std::vector<StoredRegistration>& entries,
                        const std::vector<StoredAxes>& axes);

}  // namespace palpate
