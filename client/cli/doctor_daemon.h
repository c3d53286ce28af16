// What a running palpated says of itself, judged: its device, its forces, its ticks.
//
// Pure; any thread.
#pragma once

#include <vector>

#include "client/cli/doctor_checks.h"
#include "palpate/v1/device.pb.h"

namespace palpate::cli {

Finding JudgeDevice(const v1::GetDeviceResponse& daemon);
Finding JudgeForces(const v1::ForceStatus& forces);
// From two answers, one some tenths of a second after the other.
Finding JudgeTicks(const v1::ServoDescription& before, const v1::ServoDescription& after);

}  // namespace palpate::cli
