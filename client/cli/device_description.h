// The device and the state of its forces as text and as JSON. Pure; any thread.
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
// Who leads the simulated hand; null: nobody does.
Json HandJson(const client::DaemonInfo& daemon);
// Returns the identity and role that the daemon has verified for this client.
Json CallerJson(const client::DaemonInfo& daemon);
// The state of the forces, and who set it.
Json ForcesJson(const client::DaemonInfo& daemon);

// Returns text such as "on", "held (docked)".
std::string NameOf(const client::ForceStatus& forces);
// Returns text such as "held: the stylus rests in its holder: take it out".
std::string InWords(const client::ForceStatus& forces);

// Return lines that end with \n, each with a column for its subject. Health lines without
// information are left out.
std::string DescribeCaller(const client::DaemonInfo& daemon);
std::string Describe(const client::DeviceInfo& device);
std::string Describe(const client::DeviceHealth& health);
std::string Describe(const client::ForceStatus& forces);
std::string DescribeForces(const client::DaemonInfo& daemon);
// Empty if nobody leads the hand.
std::string DescribeHand(const client::DaemonInfo& daemon);

// Returns a table. Below each unusable device it says why and what to do.
std::string Describe(const std::vector<client::ListedDevice>& list);

}  // namespace palpate::cli
