// Converts the device's values to messages of palpate.v1. Any thread.
#pragma once

#include "palpate/v1/device.pb.h"
#include "server/device/haptic_device.h"
#include "server/device/listed_device.h"
#include "server/safety/safety.h"
#include "server/security/role.h"

namespace palpate {

v1::DeviceDescription ToProto(const DeviceSpec& spec);
v1::DeviceHealth ToProto(const DeviceHealth& health);
// Does not set in_use.
v1::ListedDevice ToProto(const ListedDevice& device);
v1::CallerDescription ToProto(const Identity& caller);
// `replay`: a recording is replayed to viewers, so nothing acts.
v1::ForceStatus ToProto(ForceState state, ForceReason reason, double limit_n, bool replay);

}  // namespace palpate
