// `palpate series` on the command line.
//
// Threads: main only.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "client/cli/invocation.h"
#include "client/cli/load_options.h"

namespace palpate::cli {

// Where CLI11 puts the values.
struct SeriesValues {
  std::vector<std::string> files;
  LoadValues load;
  double number = 0.0;
  std::string on_or_off;
};

// `values` must live as long as the invocation.
void AddSeries(CLI::App& app, Invocation& invocation, SeriesValues& values);

}  // namespace palpate::cli
