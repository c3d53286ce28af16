// What palpated tells of itself as text and as JSON: volume, servo, settings, device and forces.
// Pure, except PrintWarnings and PrintNotKept; any thread.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "client/cli/json.h"
#include "client/sdk/device.h"
#include "client/sdk/settings.h"
#include "client/sdk/volume.h"

namespace palpate::cli {

// Keys keep the order in which they were set.
using palpate::Json;
using palpate::ToJson;

Json ToJson(const client::Settings& settings);

// For what is recorded and shown by a replay: ", of the replay".
std::string_view OfReplay(bool replayed);
// Throws Error (kConflict) if a replay has begun while the caller waited for a change to be felt.
void RequireLive(const client::Settings& settings);

// Appends a line: a column with the subject, then the content.
void AppendLine(std::string& text, std::string_view subject, std::string_view content);

// Return lines that end with \n, each with a column for its subject.
std::string Describe(const client::ServoDescription& servo);
std::string Describe(const client::VolumeInfo& volume);
// Settings that are off share one line.
std::string Describe(const client::Settings& settings);
// Returns the warnings of the volume's import, or "" if there are none.
std::string DescribeWarnings(const client::VolumeInfo& volume);
// Prints the same warnings on stderr, one line each.
void PrintWarnings(const client::VolumeInfo& volume);
// `why`: as SettingsResult::not_kept. Also on stderr.
void PrintNotKept(const std::string& why);

// Returns `json` with a newline at its end: on one line, or indented by `indent` spaces. Bytes that
// are not UTF-8 are replaced, because a path may have any bytes.
std::string ToText(const Json& json, int indent = -1);

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
