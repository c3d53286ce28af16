// The device, its forces and the haptic loop of the daemon. device.proto explains the fields.
//
// Units: in the names; frame D.
// Threads: plain values.
#pragma once

#include <string_view>

#include "common/contract/device.h"
#include "common/contract/enumerations.h"

namespace palpate::client {

using palpate::DeviceConnection;
using palpate::DeviceDescription;
using palpate::DeviceHealth;
using palpate::ListedDevice;
using palpate::Role;
using palpate::ServoDescription;
using palpate::VerificationLevel;

// Stands for the emergency stop where a setting's key is wanted.
inline constexpr std::string_view kStopKey = "stop";

// After a stop. A palpated that ends answers that they are off.
inline bool AreOff(palpate::ForceState state) {
  return state == palpate::ForceState::kStopped || state == palpate::ForceState::kOff;
}

using DaemonInfo = GetDeviceResponse;
using ForceResult = EnableForcesResponse;

}  // namespace palpate::client
