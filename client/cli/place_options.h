// The command line of `palpate place`.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/cli/invocation.h"

namespace palpate::cli {

// Where the options of `place` put their values; as in UpdateRegistrationRequest.
struct PlaceValues {
  bool reset = false;
  std::vector<double> center_mm;
  std::vector<double> rotation_wxyz;
  double device_mm_per_volume_mm = 0.0;
  double device_mm_per_voxel = 0.0;
  double cells_per_mm = 0.0;
  std::vector<double> move_mm;
  std::string turn_deg;
  double scale_by = 0.0;
  std::uint64_t expected_revision = 0;
  bool json = false;
};

// `values` must outlive the command.
void AddPlace(arguments::Command& app, Invocation& invocation, PlaceValues& values);

}  // namespace palpate::cli
