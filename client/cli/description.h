// Volume, servo and settings in words and in JSON. Pure; any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "client/sdk/settings.h"
#include "palpate/v1/device.pb.h"
#include "palpate/v1/geometry.pb.h"
#include "palpate/v1/volume.pb.h"

namespace palpate::cli {

// Keys keep the order in which they were set.
using Json = nlohmann::ordered_json;

// [x, y, z].
Json ToJson(const v1::Vector3& vector);
Json ToJson(const v1::ServoDescription& servo);
Json ToJson(const v1::VolumeDescription& volume);
Json ToJson(const client::Settings& settings);

// Appends a line, its content behind a column with its subject.
void AppendLine(std::string& text, std::string_view subject, std::string_view content);

// Lines that end with \n, each behind a column with its subject. Of the settings
// those that are off share a line.
std::string Describe(const v1::ServoDescription& servo);
std::string Describe(const v1::VolumeDescription& volume);
std::string Describe(const client::Settings& settings);
// What the import of the volume warned of; empty: of nothing.
std::string DescribeWarnings(const v1::VolumeDescription& volume);

// `json` with a newline at its end; on one line, or indented by `indent` spaces.
// Bytes that are not UTF-8 (a path may hold any) are replaced.
std::string ToText(const Json& json, int indent = -1);

}  // namespace palpate::cli
