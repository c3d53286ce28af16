// Volume, servo and settings in words and in JSON. Pure, but for PrintWarnings; any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "client/sdk/device.h"
#include "client/sdk/settings.h"
#include "client/sdk/volume.h"

namespace palpate::cli {

// Keys keep the order in which they were set.
using Json = nlohmann::ordered_json;

// [x, y, z].
Json ToJson(const Vec3& vector);
Json ToJson(const client::ServoInfo& servo);
Json ToJson(const client::VolumeInfo& volume);
Json ToJson(const client::Settings& settings);

// Appends a line, its content behind a column with its subject.
void AppendLine(std::string& text, std::string_view subject, std::string_view content);

// Lines that end with \n, each behind a column with its subject. Of the settings
// those that are off share a line.
std::string Describe(const client::ServoInfo& servo);
std::string Describe(const client::VolumeInfo& volume);
std::string Describe(const client::Settings& settings);
// What the import of the volume warned of; empty: of nothing.
std::string DescribeWarnings(const client::VolumeInfo& volume);
// The same on stderr, a line each.
void PrintWarnings(const client::VolumeInfo& volume);

// `json` with a newline at its end; on one line, or indented by `indent` spaces.
// Bytes that are not UTF-8 (a path may hold any) are replaced.
std::string ToText(const Json& json, int indent = -1);

}  // namespace palpate::cli
