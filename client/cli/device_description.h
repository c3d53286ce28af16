// The device and what the safety stage does, in words and in JSON. Pure; any thread.
#pragma once

#include <string>
#include <vector>

#include "client/cli/description.h"
#include "client/sdk/device.h"

namespace palpate::cli {

Json ToJson(const client::DeviceInfo& device);
Json ToJson(const client::DeviceHealth& health);
Json ToJson(const client::ForceStatus& forces);
Json ToJson(const client::ListedDevice& device);
// Whom the daemon takes us for.
Json CallerJson(const client::DaemonInfo& daemon);

// Such as "none: nothing of it was seen on hardware".
std::string InWords(client::VerificationLevel level);
// Such as "on", "held (docked)".
std::string NameOf(const client::ForceStatus& forces);
// Such as "held: the stylus rests in its holder: take it out".
std::string InWords(const client::ForceStatus& forces);

// Lines that end with \n, each behind a column with its subject. Of the health those
// that say nothing are left out.
std::string DescribeCaller(const client::DaemonInfo& daemon);
std::string Describe(const client::DeviceInfo& device);
std::string Describe(const client::DeviceHealth& health);
std::string Describe(const client::ForceStatus& forces);

// A table; below each device that is not usable, why and what to do.
std::string Describe(const std::vector<client::ListedDevice>& list);

}  // namespace palpate::cli
