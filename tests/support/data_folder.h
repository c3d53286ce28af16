// The folder of the real volumes: $PALPATE_DATA_DIR, else the folder set at configuration. Most of
// the volumes may not be redistributed, so tests skip absent ones.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/support/places.h"

namespace palpate::testing {

inline std::filesystem::path DataFolder() {
  const char* folder = std::getenv("PALPATE_DATA_DIR");
  return folder ? folder : test::kDataFolder;
}

// Where a volume is: `source` is a file in the data folder, or built in. Empty if it is missing.
inline std::string PlaceOf(const std::string& source) {
  if (source.starts_with("builtin:")) return source;
  const auto path = std::filesystem::weakly_canonical(DataFolder() / source);
  return std::filesystem::exists(path) ? path.string() : "";
}
inline constexpr const char* kMissing = " is missing: see PALPATE_DATA_DIR";

}  // namespace palpate::testing
