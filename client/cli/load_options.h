// `palpate load` on the command line, and its options where other commands have
// them too.
//
// Threads: main only.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/invocation.h"
#include "palpate/v1/volume.pb.h"

namespace palpate::cli {

// Where the options put their values.
struct LoadValues {
  std::string source;
  std::optional<double> isovalue;
  std::optional<double> normalized_isovalue;
  std::vector<double> spacing_mm;  // three, or none
  std::optional<double> device_mm_per_volume_mm;
  std::vector<std::uint32_t> raw_size;  // three, or none
  std::string raw_type;
  bool raw_big_endian = false;
  std::uint64_t raw_offset_bytes = 0;
  std::optional<std::uint32_t> frame;
  std::string grid;
  std::string component;
};

// All but the source and the frame.
void AddVolumeOptions(arguments::Command& command, LoadValues& values);
void AddFrameOption(arguments::Command& command, LoadValues& values);

// Without the source.
v1::LoadVolumeRequest RequestOf(const LoadValues& values);

// `values` must live as long as the invocation.
void AddLoad(arguments::Command& app, Invocation& invocation, LoadValues& values);

}  // namespace palpate::cli
