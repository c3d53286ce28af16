// Judges what a running palpated reports: its device, its forces, its ticks.
//
// Pure; any thread. Apart for its tests.
#pragma once

#include <vector>

#include "client/cli/doctor/checks.h"
#include "client/sdk/device.h"
#include "client/sdk/pose.h"

namespace palpate::cli {

using doctor::Finding;
using doctor::Verdict;

Finding JudgeDevice(const client::DaemonInfo& daemon);
// Leaves one finding about each fault: the daemon's word about its device counts. Takes what
// speaks against devices of its kind out of `findings`. If `device` fails, it gets their advice.
void TakeOver(const std::string& kind, Finding& device, std::vector<Finding>& findings);
Finding JudgeForces(const client::ForceStatus& forces);
// Compares two answers. The second comes some tenths of a second after the first.
Finding JudgeTicks(const client::ServoDescription& before, const client::ServoDescription& after);

}  // namespace palpate::cli
