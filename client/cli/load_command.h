// `palpate load` and `palpate upload`, and their options where other commands have them too.
//
// Threads: main only.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/cli/invocation.h"

namespace palpate::cli {

// Where the options put their values.
struct LoadValues {
  std::string source;
  client::LoadOptions options;
  std::vector<double> spacing_mm;       // three, or none
  std::vector<std::uint32_t> raw_size;  // three, or none
  std::string raw_type;
  client::RawVoxels raw;
};

// All but the source and the frame.
void AddVolumeOptions(arguments::Command& command, LoadValues& values);

client::LoadOptions OptionsOf(const LoadValues& values);

}  // namespace palpate::cli
