// Figures and the newest sample as text. Pure; any thread.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "client/cli/watch_statistics.h"
#include "client/sdk/pose.h"

namespace palpate::cli {

struct WatchStatus {
  std::string server;
  WatchFigures figures;
  // Absent before the first one.
  std::optional<client::Pose> pose;
  // Over the volume's range; absent when that is not known.
  std::optional<double> normalized_isovalue;
  // Full length of the force bar; 0: no bar.
  double max_force_n = 0.0;
  // Between machines the age leaves the shortest network delay out.
  bool age_is_exact = true;
};

// The live view: lines without newlines, none wider than `columns` characters,
// `rows` of them at most.
std::vector<std::string> LiveView(const WatchStatus& status, int columns, int rows);

// The same on one line, for a log.
std::string LogLine(const WatchStatus& status);

// The end of watching; lines that end with \n.
std::string Summary(const WatchFigures& figures);

}  // namespace palpate::cli
