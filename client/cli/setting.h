// Settings in words and in JSON, by the client library's list: what `palpate set` changes and
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

// By its name or key, the isovalue's included; null: there is none.
const Setting* FindSetting(std::string_view name);

// What it may be, where that is one of some words: on and off, below and above. Empty: a number.
std::vector<std::string_view> WordsOf(const Setting& setting);

// What it may be: "0 to 3 N/mm", "on or off".
std::string ValuesOf(const Setting& setting);

// A line for each setting: name, what it may be, what it does.
std::string ListOfSettings();

// Puts `text` into the setting's member; false, and nothing is put, where `text` is
// no value of its kind. The daemon checks the ranges.
bool StoreSetting(const Setting& setting, const std::string& text, client::SettingsUpdate& update);

// Number, true or false, or word; null where the daemon has none that is known here.
nlohmann::ordered_json SettingJson(const Setting& setting, const client::Settings& settings);

// Such as "stiffness 0.5 N/mm", "force_shading on", "method bcc".
std::string DescribeSetting(const Setting& setting, const client::Settings& settings);

// 0 or false.
bool IsOff(const Setting& setting, const client::Settings& settings);

}  // namespace palpate::cli
