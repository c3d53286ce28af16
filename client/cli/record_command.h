// `palpate record`, `palpate mark` and `palpate replay`.
//
// Threads: main only. Apart for its tests.
#pragma once

#include <optional>
#include <string>

#include "client/cli/description.h"
#include "client/cli/invocation.h"

namespace palpate::cli {

// Returns text such as "60000 ticks (60.0 s), 0 lost, 6.2 MB, 103 bytes per tick, to
// /data/a.mcap". Pure.
std::string DescribeRecording(const client::RecordingState& state);

// What viewers see: the live ticks, or the replay. Returns lines that end with \n. Pure.
std::string DescribeReplay(const std::optional<client::RunningReplay>& replay);

}  // namespace palpate::cli
