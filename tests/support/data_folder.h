// The folder of the real volumes: $PALPATE_DATA_DIR, else the folder set at configuration. Most of
// the volumes may not be redistributed, so tests skip absent ones.
#pragma once

#include <cstdlib>
#include <filesystem>

#include "tests/support/places.h"

namespace palpate::testing {

inline std::filesystem::path DataFolder() {
  const char* folder = std::getenv("PALPATE_DATA_DIR");
  return folder ? folder : test::kDataFolder;
}

}  // namespace palpate::testing
