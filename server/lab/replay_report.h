// Reports a replay as numbers, as a line of JSON, and as a table of ticks.
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
  // Times of one haptic update.
  double mean_ns = 0.0;
  std::int64_t p50_ns = 0;
  std::int64_t p99_ns = 0;
  std::int64_t max_ns = 0;

  double contact_share() const;
  // The share of the ticks in contact that have SCP_V; 1 if no tick is in contact.
  double scp_v_share() const;
  // Means over the ticks with SCP_V.
  double mean_scp_hv_voxels() const;
  double mean_force_angle_deg() const;
};

ReplaySummary Summarise(const std::vector<ReplayTick>& ticks, Verdict verdict);

// One object on one line, without a line end. Counts that were not judged are null.
std::string ToJson(const ReplaySummary& summary);

// One row per tick, with all digits of the numbers. Missing numbers are nan: SCP_V if scp_v_valid
// is 0, SCP_H before the first finite HIP.
std::string ToCsv(const std::vector<ReplayTick>& ticks, const std::vector<double>& density);

}  // namespace palpate::lab
