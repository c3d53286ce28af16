// Settings as text and as JSON, from the client library's list: what `palpate set` changes and
// `palpate settings` prints; and their layers.
//
// Values in data units, forces and lengths of the device. Pure; any thread.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "client/cli/json.h"
#include "client/sdk/settings.h"
#include "common/contract/render.h"

namespace palpate::cli {

// Skin over bone for CT in HU, as LayersOfList takes it.
inline constexpr std::string_view kSkinBone = "skin=-300,bone=300";

// A layer without an id, which the daemon gives. `holds`: firm, and nothing passes it; else soft,
// and the stylus passes it at 1 N.
SurfaceLayer NewLayer(const std::string& name, bool holds);

// Of "NAME=ISOVALUE,...", or of "skin-bone". The one with the greatest isovalue holds; the others
// are soft. `isovalue_of` gives an isovalue for its text. Errors: kInvalidArgument.
SurfaceLayers LayersOfList(const std::string& list,
                           const std::function<double(const std::string&)>& isovalue_of);

// "1 skin: isovalue -300, 0.3 N/mm, pops at 1 N"
std::string Describe(const SurfaceLayer& layer);
// Lines that end with \n; for none: that the one surface is felt.
std::string Describe(const SurfaceLayers& layers);

// What ToJson made of layers. Errors: kInvalidArgument.
SurfaceLayers LayersOfJson(const std::string& text);

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
Json SettingJson(const Setting& setting, const client::Settings& settings);

// Returns text such as "stiffness 0.5 N/mm", "force_shading on", "method bcc".
std::string DescribeSetting(const Setting& setting, const client::Settings& settings);

// True if the value is 0 or false.
bool IsOff(const Setting& setting, const client::Settings& settings);

}  // namespace palpate::cli
