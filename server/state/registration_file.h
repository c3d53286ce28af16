// Where volumes lay when they were felt last, as a TOML file.
//
// Frames and units as in registration.h. Any thread; not for real-time code.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate {

// Of one volume, which its source names: a path, a builtin or an upload. Another
// size or spacing is another volume.
struct StoredRegistration {
  std::string source;
  Vec3i size = Vec3i::Zero();
  Vec3 spacing_mm = Vec3::Ones();
  Vec3 p_DCenter_mm = Vec3::Zero();
  Eigen::Quaterniond R_DW = Eigen::Quaterniond::Identity();
  double device_mm_per_volume_mm = 1.0;
};

struct RegistrationFile {
  std::vector<StoredRegistration> entries;  // oldest first
  std::string damage;                       // what could not be read, one line; empty: nothing
};

// No entries where there is no such file. What is damaged is left out and said.
RegistrationFile ReadRegistrations(const std::filesystem::path& path);

// The file is whole or as it was; its folder is made where it is missing. Sources
// that a TOML file cannot hold (a path need not be UTF-8) are left out. Throws
// Error (kUnavailable).
void WriteRegistrations(const std::filesystem::path& path,
                        const std::vector<StoredRegistration>& entries);

}  // namespace palpate
