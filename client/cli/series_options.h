// `palpate series` on the command line.
//
// Threads: main only.
#pragma once

#include <string>
#include <vector>

#include "client/cli/invocation.h"
#include "client/cli/load_options.h"

namespace palpate::cli {

// Where the options put their values.
struct SeriesValues {
  std::vector<std::string> files;
  LoadValues load;
  double number = 0.0;
  std::string on_or_off;
};

// `values` must live as long as the invocation.
void AddSeries(arguments::Command& app, Invocation& invocation, SeriesValues& values);

}  // namespace palpate::cli
