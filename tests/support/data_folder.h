// Where the real volumes lie: $PALPATE_DATA_DIR, else the folder set at
// configuration. Most of them may not be redistributed: tests skip what is absent.
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
