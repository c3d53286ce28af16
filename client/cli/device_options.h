// `palpate device` on the command line.
//
// Threads: main only.
#pragma once

#include <string>

#include "client/cli/invocation.h"

namespace palpate::cli {

// Where the options put their values.
struct DeviceValues {
  std::string name;
  double seconds = 2.0;
};

// `values` must live as long as the invocation.
void AddDevice(arguments::Command& app, Invocation& invocation, DeviceValues& values);

}  // namespace palpate::cli
