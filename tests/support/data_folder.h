// The folder of the real volumes: $PALPATE_DATA_DIR, else the folder set at configuration. Most of
// the volumes may not be redistributed, so tests skip absent ones. And the surfaces in them that
// tests are held on.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <ostream>
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

struct KnownSurface {
  const char* name;
  const char* source;  // as for PlaceOf
  double isovalue;     // normalised, or in the data's units
  bool is_absolute = false;
};
inline void PrintTo(const KnownSurface& known, std::ostream* out) { *out << known.name; }
// Of a case, for INSTANTIATE_TEST_SUITE_P.
inline constexpr auto kNameOf = [](const auto& known) { return std::string(known.param.name); };

inline constexpr const char* kDaisy = "paper/daisy_192x180x168_uint8.nhdr";
inline constexpr const char* kOrange = "paper/orange_256x256x64_uint8.nhdr";
inline constexpr const char* kLobster = "paper/lobster_301x324x56_uint8.nhdr";
inline constexpr const char* kHead = "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd";
inline constexpr KnownSurface kPaperSurfaces[] = {
    {"daisy_02", kDaisy, 0.02},     {"daisy_24", kDaisy, 0.24}, {"orange_22", kOrange, 0.22},
    {"lobster_16", kLobster, 0.16}, {"head_17", kHead, 0.17},   {"head_33", kHead, 0.33}};

}  // namespace palpate::testing
