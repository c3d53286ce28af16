// The client's list of settings: complete, and true to the daemon's.
#include "client/cli/setting.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "client/cli/description.h"
#include "common/isosurface/decomposition.h"
#include "server/haptics/settings.h"

namespace palpate::cli {
namespace {

TEST(CliSetting, EveryFieldIsListed) {
  const auto* fields = v1::RenderSettings::descriptor();
  EXPECT_EQ(fields->field_count(), static_cast<int>(kSettings.size()) + 2);
  for (int n = 0; n < fields->field_count(); ++n) {
    const Setting* setting = FindSetting(fields->field(n)->name());
    ASSERT_NE(setting, nullptr) << fields->field(n)->name();
    EXPECT_EQ(setting->key, fields->field(n)->name());
    EXPECT_EQ(FindSetting(setting->name), setting);
    EXPECT_TRUE(setting->key.starts_with(setting->name));
  }
  EXPECT_EQ(FindSetting("friction"), nullptr);
  EXPECT_EQ(FindSetting(""), nullptr);
}

TEST(CliSetting, UnitsAndRangesAreTheDaemons) {
  for (const NumberSetting& theirs : kNumberSettings) {
    const Setting* ours = FindSetting(theirs.key);
    ASSERT_NE(ours, nullptr) << theirs.key;
    EXPECT_EQ(ours->unit, theirs.unit) << theirs.key;
    EXPECT_EQ(ours->values, fmt::format("{:g} to {:g}{}", theirs.low, theirs.high, theirs.unit));
  }
}

TEST(CliSetting, NamesOfValuesAreTheDaemons) {
  v1::RenderSettings settings;
  const auto takes_all = [&settings](std::string_view key, const auto& names) {
    const Setting& setting = *FindSetting(key);
    for (const std::string_view name : names) {
      EXPECT_TRUE(StoreSetting(setting, std::string(name), settings)) << name;
      EXPECT_EQ(SettingJson(setting, settings), std::string(name));
      EXPECT_NE(setting.values.find(name), std::string_view::npos) << name;
    }
  };
  takes_all("method", kMethodNames);
  EXPECT_EQ(settings.method(), v1::DECOMPOSITION_METHOD_TPBCC);
  takes_all("free_side", kFreeSideNames);
  EXPECT_EQ(settings.free_side(), v1::FREE_SIDE_ABOVE);
}

TEST(CliSetting, NumbersFlagsAndNamesAreTold) {
  v1::RenderSettings settings;
  const auto told = [&settings](std::string_view name, const std::string& value) {
    const Setting& setting = *FindSetting(name);
    EXPECT_TRUE(StoreSetting(setting, value, settings)) << value;
    return DescribeSetting(setting, settings);
  };
  EXPECT_EQ(told("pop_force", "2.50"), "pop_force 2.5 N");
  EXPECT_EQ(told("damping", "1e-3"), "damping 0.001 N·s/m");
  EXPECT_EQ(told("static_friction", "-0.5"), "static_friction -0.5");  // the daemon's to refuse
  EXPECT_EQ(told("force_shading", "true"), "force_shading on");
  EXPECT_EQ(told("passivity_control", "off"), "passivity_control off");
  EXPECT_TRUE(settings.has_passivity_control());
  EXPECT_EQ(told("free_side", "above"), "free_side above");
  EXPECT_EQ(told("method", "tpbcc-published"), "method tpbcc-published");
}

TEST(CliSetting, AnythingElseIsNotStored) {
  v1::RenderSettings settings;
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
    EXPECT_FALSE(StoreSetting(*FindSetting(name), value, settings)) << name << " " << value;
  }
  EXPECT_EQ(settings.ByteSizeLong(), 0u);
}

TEST(CliSetting, ValuesOfANewerDaemonAreUnknown) {
  v1::RenderSettings settings;
  settings.set_free_side(static_cast<v1::FreeSide>(17));
  EXPECT_EQ(DescribeSetting(*FindSetting("free_side"), settings), "free_side unknown");
}

TEST(CliSetting, WhatIsOffSharesALine) {
  v1::RenderSettings settings;
  settings.set_isovalue(0.0);
  settings.set_stiffness_n_per_mm(0.5);
  settings.set_damping_n_s_per_m(0.0);
  settings.set_pop_force_n(2.0);
  settings.set_force_shading(false);
  settings.set_free_side(v1::FREE_SIDE_BELOW);
  EXPECT_EQ(Describe(settings, 3),
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
  const Json json = ToJson(settings, 3);
  for (const Setting& setting : kSettings) {
    EXPECT_TRUE(json.contains(std::string(setting.key))) << setting.key;
  }
  EXPECT_EQ(json["pop_force_n"], 2.0);
  EXPECT_EQ(json["force_shading"], false);
  EXPECT_TRUE(json["free_side"].is_null());  // of an older daemon
}

}  // namespace
}  // namespace palpate::cli
