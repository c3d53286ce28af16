// The figures and the newest sample as text. Pure; any thread. Apart for its tests.
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
  // Absent before the first sample.
  std::optional<client::Pose> pose;
  // Fraction of the volume's range; absent if the range is not known.
  std::optional<double> normalized_isovalue;
  // The pose's SCP_H in the world, mm; absent if the volume's place is not known.
  std::optional<Vec3> scp_h_world_mm;
  // The force of a full bar; 0: no bar.
  double max_force_n = 0.0;
  // False between machines: the age then lacks the shortest network delay.
  bool age_is_exact = true;
  // Samples this late or later are old: the daemon, or the way to it, is silent.
  double old_after_ms = 500.0;
};

// The live view: at most `rows` lines without newlines, each at most `columns` characters wide.
std::vector<std::string> LiveView(const WatchStatus& status, int columns, int rows);

// The same figures on one line, for a log.
std::string LogLine(const WatchStatus& status);

// The summary at the end; lines end with \n.
std::string Summary(const WatchFigures& figures);

}  // namespace palpate::cli
