// `palpate load` and `palpate upload`, and the options that other commands share with them.
//
// Threads: main only.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/cli/invocation.h"

namespace palpate::cli {

// The values of the options.
struct LoadValues {
  std::string source;
  client::LoadOptions options;
  std::vector<std::string> settings;    // KEY=VALUE, checked
  std::vector<double> spacing_mm;       // three or none
  std::vector<std::uint32_t> raw_size;  // three or none
  std::string raw_type;
  client::RawVoxels raw;
};

// Adds all options except the source and the frame.
void AddVolumeOptions(arguments::Command& command, LoadValues& values);

client::LoadOptions OptionsOf(const LoadValues& values);

}  // namespace palpate::cli
