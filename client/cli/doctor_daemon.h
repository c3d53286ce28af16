// What a running palpated says of itself, judged: its device, its forces, its ticks.
//
// Pure; any thread.
#pragma once

#include <vector>

#include "client/doctor/checks.h"
#include "client/sdk/device.h"

namespace palpate::cli {

using doctor::Finding;
using doctor::Verdict;

Finding JudgeDevice(const client::DaemonInfo& daemon);
Finding JudgeForces(const client::ForceStatus& forces);
// From two answers, one some tenths of a second after the other.
Finding JudgeTicks(const client::ServoInfo& before, const client::ServoInfo& after);

}  // namespace palpate::cli
