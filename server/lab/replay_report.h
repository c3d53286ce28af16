// A replay in numbers, a line of JSON, and a table of ticks.
//
// Threads: pure functions.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "server/lab/replay_judge.h"

namespace palpate::lab {

struct ReplaySummary {
  int ticks = 0;
  Verdict verdict;
  // Of one haptic update.
  double mean_ns = 0.0;
  std::int64_t p50_ns = 0;
  std::int64_t p99_ns = 0;
  std::int64_t max_ns = 0;

  double contact_share() const;
  // Of the ticks in contact; 1 where there are none.
  double scp_v_share() const;
};

ReplaySummary Summarise(const std::vector<ReplayTick>& ticks, Verdict verdict);

// One object on one line without its end. What was not judged is null.
std::string ToJson(const ReplaySummary& summary);

// One row a tick, with as many digits as the numbers have. Numbers that are not
// there are nan: SCP_V where scp_v_valid is 0, SCP_H before the first finite HIP.
std::string ToCsv(const std::vector<ReplayTick>& ticks, const std::vector<double>& density);

}  // namespace palpate::lab
