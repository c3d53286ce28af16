// Settings in words: complete, and true to the daemon's.
#include "client/cli/setting.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "client/cli/description.h"
#include "client/sdk/setting_messages.h"
#include "common/isosurface/decomposition.h"
#include "server/haptics/settings.h"

namespace palpate::cli {
namespace {

using client::kSettings;

// As a daemon with these settings tells them.
client::Settings Told(const v1::RenderSettings& settings) { return client::FromProto(settings, 3); }

client::Settings Told(const client::SettingsUpdate& update) {
  return Told(client::ToProto(update).settings());
}

TEST(CliSetting, EveryFieldIsListed) {
  const auto* fields = v1::RenderSettings::descriptor();
  EXPECT_EQ(fields->field_count(), static_cast<int>(kSettings.size()));
  const std::string list = ListOfSettings();
  for (int n = 0; n < fields->field_count(); ++n) {
    const Setting* setting = FindSetting(fields->field(n)->name());
    ASSERT_NE(setting, nullptr) << fields->field(n)->name();
    EXPECT_EQ(setting->key, fields->field(n)->name());
    EXPECT_EQ(FindSetting(setting->name), setting);
    EXPECT_TRUE(setting->key.starts_with(setting->name));
    EXPECT_NE(list.find(fmt::format("  {} ", setting->name)), std::string::npos) << setting->name;
    EXPECT_NE(list.find(fmt::format("{}; {}\n", ValuesOf(*setting), setting->help)),
              std::string::npos);
  }
  EXPECT_EQ(FindSetting("friction"), nullptr);
  EXPECT_EQ(FindSetting(""), nullptr);
}

TEST(CliSetting, UnitsAndRangesAreTheDaemons) {
  for (const NumberSetting& theirs : kNumberSettings) {
    const Setting* ours = FindSetting(theirs.key);
    ASSERT_NE(ours, nullptr) << theirs.key;
    EXPECT_EQ(ValuesOf(*ours), fmt::format("{:g} to {:g}{}", theirs.low, theirs.high, theirs.unit));
    EXPECT_TRUE(WordsOf(*ours).empty());
  }
}

TEST(CliSetting, DefaultsAreTheDaemons) {
  const client::Settings ours;
  const HapticSettings theirs;
  for (const NumberSetting& setting : kNumberSettings) {
    EXPECT_EQ(SettingJson(*FindSetting(setting.key), ours), theirs.*setting.member) << setting.key;
  }
  for (const FlagSetting& setting : kFlagSettings) {
    EXPECT_EQ(SettingJson(*FindSetting(setting.key), ours), theirs.*setting.member) << setting.key;
  }
  EXPECT_EQ(SettingJson(*FindSetting("free_side"), ours),
            std::string(FreeSideName(theirs.free_side)));
}

TEST(CliSetting, NamesOfValuesAreTheDaemons) {
  client::SettingsUpdate update;
  const auto takes_all = [&update](std::string_view key, const auto& names) {
    const Setting& setting = *FindSetting(key);
    EXPECT_EQ(WordsOf(setting).size(), names.size());
    for (const std::string_view name : names) {
      EXPECT_TRUE(StoreSetting(setting, std::string(name), update)) << name;
      EXPECT_EQ(SettingJson(setting, Told(update)), std::string(name));
      EXPECT_NE(ValuesOf(setting).find(name), std::string::npos) << name;
    }
  };
  takes_all("method", kMethodNames);
  EXPECT_EQ(update.method, DecompositionMethod::kTpbcc);
  takes_all("free_side", kFreeSideNames);
  EXPECT_EQ(update.free_side, client::FreeSide::kAbove);
  EXPECT_EQ(ValuesOf(*FindSetting("method")), "bcc, tpbcc, tptd or tpbcc-published");
}

TEST(CliSetting, NumbersFlagsAndNamesAreTold) {
  client::SettingsUpdate update;
  const auto told = [&update](std::string_view name, const std::string& value) {
    const Setting& setting = *FindSetting(name);
    EXPECT_TRUE(StoreSetting(setting, value, update)) << value;
    return DescribeSetting(setting, Told(update));
  };
  EXPECT_EQ(told("pop_force", "2.50"), "pop_force 2.5 N");
  EXPECT_EQ(told("damping", "1e-3"), "damping 0.001 N·s/m");
  EXPECT_EQ(told("static_friction", "-0.5"), "static_friction -0.5");  // the daemon's to refuse
  EXPECT_EQ(told("force_shading", "true"), "force_shading on");
  EXPECT_EQ(told("passivity_control", "off"), "passivity_control off");
  EXPECT_EQ(update.passivity_control, false);
  EXPECT_EQ(told("free_side", "above"), "free_side above");
  EXPECT_EQ(told("method", "tpbcc-published"), "method tpbcc-published");
}

TEST(CliSetting, AnythingElseIsNotStored) {
  client::SettingsUpdate update;
  for (const auto& [name, value] :
       std::vector<std::pair<std::string, std::string>>{{"stiffness", ""},
                                                        {"stiffness", "nan"},
                                                        {"stiffness", "inf"},
                                                        {"stiffness", "1e999"},
                                                        {"stiffness", "1 "},
                                                        {"stiffness", "1N"},
                                                        {"stiffness", "on"},
                                                        {"force_shading", "1"},
                                                        {"force_shading", ""},
                                                        {"free_side", "unspecified"},
                                                        {"free_side", "BELOW"},
                                                        {"free_side", "1"},
                                                        {"method", "FREE_SIDE_BELOW"}}) {
    EXPECT_FALSE(StoreSetting(*FindSetting(name), value, update)) << name << " " << value;
  }
  EXPECT_EQ(client::ToProto(update).update_mask().paths_size(), 0);
}

TEST(CliSetting, ValuesOfANewerDaemonAreUnknown) {
  v1::RenderSettings settings;
  settings.set_free_side(static_cast<v1::FreeSide>(17));
  EXPECT_EQ(DescribeSetting(*FindSetting("free_side"), Told(settings)), "free_side unknown");
}

TEST(CliSetting, WhatIsOffSharesALine) {
  v1::RenderSettings settings;
  settings.set_isovalue(0.0);
  settings.set_stiffness_n_per_mm(0.5);
  settings.set_damping_n_s_per_m(0.0);
  settings.set_pop_force_n(2.0);
  settings.set_force_shading(false);
  settings.set_free_side(v1::FREE_SIDE_BELOW);
  EXPECT_EQ(Describe(Told(settings)),
            "settings  revision 3\n"
            "          isovalue 0\n"
            "          stiffness 0.5 N/mm\n"
            "          pop_force 2 N\n"
            "          free_side below\n"
            "          off: damping, force_shading\n");
}

TEST(CliSetting, JsonHasAllByTheirKeys) {
  v1::RenderSettings settings;
  settings.set_pop_force_n(2.0);
  settings.set_force_shading(false);
  const Json json = ToJson(Told(settings));
  for (const Setting& setting : kSettings) {
    EXPECT_TRUE(json.contains(std::string(setting.key))) << setting.key;
  }
  EXPECT_EQ(json["pop_force_n"], 2.0);
  EXPECT_EQ(json["force_shading"], false);
  EXPECT_TRUE(json["free_side"].is_null());  // of an older daemon
}

}  // namespace
}  // namespace palpate::cli
