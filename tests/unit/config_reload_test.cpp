// Which keys a reload takes over, and what a whole configuration is refused for.
#include "server/app/reload.h"

#include <gtest/gtest.h>

#include <fstream>

#include "server/app/config_check.h"
#include "tests/support/temporary_folder.h"

namespace palpate::test {
namespace {

using Keys = std::vector<std::string>;

ConfigReading Read(const std::string& text, Config& config) {
  TemporaryFolder folder;
  std::ofstream(folder.path() / "palpated.toml") << text;
  return ReadConfig(folder.path() / "palpated.toml", config);
}

ConfigKeys KeysOf(const std::string& text) {
  Config config;
  return Read(text, config).keys;
}

TEST(ConfigReload, SeesKeysThatChangedCameAndWent) {
  const ConfigKeys before = KeysOf(
      "[haptics]\nstiffness_n_per_mm = 0.5\npop_force_n = 1\n"
      "[volume]\nload_folders = [\"/\", \"/tmp\"]\n");
  EXPECT_EQ(ChangedKeys(before, before), Keys());
  // Lines, order and spaces are not what counts.
  EXPECT_EQ(
      ChangedKeys(before, KeysOf("[volume]\n# here\nload_folders = [ \"/\",\"/tmp\" ]\n\n"
                                 "[haptics]\npop_force_n = 1.0\nstiffness_n_per_mm = 0.50\n")),
      Keys());
  EXPECT_EQ(ChangedKeys(before, KeysOf("[haptics]\nstiffness_n_per_mm = 0.6\nmethod = \"bcc\"\n"
                                       "[volume]\nload_folders = [\"/\", \"/var\"]\n")),
            (Keys{"haptics.method", "haptics.pop_force_n", "haptics.stiffness_n_per_mm",
                  "volume.load_folders"}));
}

TEST(ConfigReload, OnlyWhatIsFeltAndTheLogIsLive) {
  for (const NumberSetting& setting : kNumberSettings) {
    EXPECT_TRUE(IsLive("haptics." + std::string(setting.key)));
  }
  for (const char* key : {"volume.isovalue", "volume.normalized_isovalue", "log.level"}) {
    EXPECT_TRUE(IsLive(key)) << key;
  }
  for (const char* key : {"volume.source", "device.kind", "server.listen", "realtime.priority",
                          "state.folder", "volume.spacing_mm"}) {
    EXPECT_FALSE(IsLive(key)) << key;
  }
}

TEST(ConfigReload, UpdatesOnlyTheKeysThatAreNamed) {
  Config config;
  config.haptics.stiffness_n_per_mm = 0.9;
  config.haptics.pop_force_n = 2.0;
  config.haptics.force_shading = true;
  const SettingsUpdate update =
      UpdateOf({"haptics.force_shading", "haptics.stiffness_n_per_mm"}, config);
  ASSERT_EQ(update.numbers.size(), 1u);
  EXPECT_EQ(update.numbers[0].first, &HapticSettings::stiffness_n_per_mm);
  EXPECT_EQ(update.numbers[0].second, 0.9);
  ASSERT_EQ(update.flags.size(), 1u);
  EXPECT_TRUE(update.flags[0].second);
  EXPECT_FALSE(update.isovalue || update.normalized_isovalue || update.free_side || update.method);
}

TEST(ConfigReload, AnIsovalueThatIsTakenOutIsTheDefaultOne) {
  EXPECT_EQ(UpdateOf({"volume.isovalue"}, Config{}).normalized_isovalue, 0.5);
  Config config;
  config.isovalue = 300.0;
  const SettingsUpdate update = UpdateOf({"volume.isovalue"}, config);
  EXPECT_EQ(update.isovalue, 300.0);
  EXPECT_FALSE(update.normalized_isovalue);
}

TEST(ConfigCheck, SaysEveryFaultInTheOrderOfLines) {
  Config config;
  const ConfigReading reading =
      Read("[realtime]\npriority = 100\ncpu = 0\n[haptics]\nstiff = 1\npop_force_n = 9\n", config);
  ASSERT_EQ(reading.faults.size(), 3u);
  EXPECT_EQ(reading.faults[0].line, 2u);
  EXPECT_EQ(reading.faults[1].line, 5u);
  EXPECT_EQ(ToText("f.toml", reading.faults[2]),
            "f.toml:6: haptics.pop_force_n must be from 0 to 3.3 N");
  EXPECT_EQ(config.realtime.cpu, 0);
}

// One fault, of this key.
void ExpectFault(const std::string& text, const std::string& key, std::size_t line) {
  Config config;
  const ConfigReading reading = Read(text, config);
  ASSERT_TRUE(reading.faults.empty()) << text;
  const std::vector<ConfigFault> faults = CheckConfig(config, reading.keys);
  ASSERT_EQ(faults.size(), 1u) << text;
  EXPECT_EQ(faults[0].key, key) << text;
  EXPECT_EQ(faults[0].line, line) << text;
}

TEST(ConfigCheck, LooksAtTheWhole) {
  EXPECT_TRUE(CheckConfig(Config{}, {}).empty());
  ExpectFault("[volume]\nsource = \"/no/such.nrrd\"\n", "volume.source", 2);
  ExpectFault("[volume]\nsource = \"builtin:cube\"\n", "volume.source", 2);
  ExpectFault("[volume]\nisovalue = 1\nnormalized_isovalue = 0.1\n", "volume.normalized_isovalue",
              3);
  ExpectFault("[volume]\nnormalized_isovalue = 1.5\n", "volume.normalized_isovalue", 2);
  ExpectFault("[device]\n\nkind = \"omni\"\n", "device.kind", 3);
  ExpectFault("[device]\nkind = \"replay\"\n", "device.kind", 2);
  ExpectFault("[device]\nfalcon_firmware = \"/no/such\"\n", "device.falcon_firmware", 2);
  ExpectFault("[device]\nkind = \"falcon\"\nstop_buttons = 0\n[haptics]\nmethod = \"tptd\"\n",
              "haptics.method", 5);
  ExpectFault("[server]\nsocket = \"/tmp/a b\"\n", "server.socket", 2);
  ExpectFault("[realtime]\ncpu = 1023\n", "realtime.cpu", 2);
}

}  // namespace
}  // namespace palpate::test
