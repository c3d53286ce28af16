// Settings as text and as JSON, from the client library's list: what `palpate set` changes and
// `palpate settings` shows.
//
// Pure; any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "client/sdk/settings.h"

namespace palpate::cli {

using client::Setting;

// Finds a setting by its name or key, also the isovalue. Returns null if there is none.
const Setting* FindSetting(std::string_view name);

// Returns the words that the setting accepts, such as on and off, or below and above. Empty if the
// setting is a number.
std::vector<std::string_view> WordsOf(const Setting& setting);

// Returns the accepted values as text: "0 to 3 N/mm", "on or off".
std::string ValuesOf(const Setting& setting);

// One line for each setting: its name, its accepted values, its effect.
std::string ListOfSettings();

// Parses `text` into the setting's member. Returns false and stores nothing if `text` is not a
// value of the setting's kind. The daemon checks the ranges.
bool StoreSetting(const Setting& setting, const std::string& text, client::SettingsUpdate& update);

// Returns a number, true or false, or a word. Null if the daemon has no value that this client
// knows.
nlohmann::ordered_json SettingJson(const Setting& setting, const client::Settings& settings);

// Returns text such as "stiffness 0.5 N/mm", "force_shading on", "method bcc".
std::string DescribeSetting(const Setting& setting, const client::Settings& settings);

// True if the value is 0 or false.
bool IsOff(const Setting& setting, const client::Settings& settings);

}  // namespace palpate::cli
