// The device and what the safety stage does, in words and in JSON. Pure; any thread.
#pragma once

#include <string>

#include "client/cli/description.h"
#include "palpate/v1/device.pb.h"

namespace palpate::cli {

Json ToJson(const v1::CallerDescription& caller);
Json ToJson(const v1::DeviceDescription& device);
Json ToJson(const v1::DeviceHealth& health);
Json ToJson(const v1::ForceStatus& forces);
Json ToJson(const v1::ListedDevice& device);

// "none", "enumerated", "identified", "state_read", "force_verified", "simulated".
std::string NameOf(v1::VerificationLevel level);
// Such as "none: nothing of it was seen on hardware".
std::string InWords(v1::VerificationLevel level);
// "absent", "connecting", "streaming".
std::string NameOf(v1::DeviceConnection connection);
// Such as "on", "held (docked)".
std::string NameOf(const v1::ForceStatus& forces);
// Such as "held: the stylus rests in its holder: take it out".
std::string InWords(const v1::ForceStatus& forces);

// Lines that end with \n, each behind a column with its subject. Of the health those
// that say nothing are left out.
std::string Describe(const v1::CallerDescription& caller);
std::string Describe(const v1::DeviceDescription& device);
std::string Describe(const v1::DeviceHealth& health);
std::string Describe(const v1::ForceStatus& forces);

// A table; below each device that is not usable, why and what to do.
std::string Describe(const v1::ListDevicesResponse& list);

}  // namespace palpate::cli
