// The device and the state of its forces as text and as JSON. Pure; any thread.
#pragma once

#include <string>
#include <vector>

#include "client/cli/description.h"
#include "client/sdk/device.h"

namespace palpate::cli {

// Who leads the simulated hand; null: nobody does.
Json HandJson(const client::DaemonInfo& daemon);
// The state of the forces, and who set it.
Json ForcesJson(const client::DaemonInfo& daemon);

// Returns text such as "on", "held (docked)".
std::string NameOf(const client::ForceStatus& forces);
// Returns text such as "held: the stylus rests in its holder: take it out".
std::string InWords(const client::ForceStatus& forces);

// Return lines that end with \n, each with a column for its subject. Health lines without
// information are left out.
std::string DescribeCaller(const client::DaemonInfo& daemon);
std::string Describe(const client::DeviceDescription& device);
std::string Describe(const client::DeviceHealth& health);
std::string Describe(const client::ForceStatus& forces);
std::string DescribeForces(const client::DaemonInfo& daemon);
// Empty if nobody leads the hand.
std::string DescribeHand(const client::DaemonInfo& daemon);

// Returns a table. Below each unusable device it says why and what to do.
std::string Describe(const std::vector<client::ListedDevice>& list);

}  // namespace palpate::cli
