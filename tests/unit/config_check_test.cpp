// What a whole configuration is refused for: at --check-config, at start, at a reload; and what a
// reload takes over.
#include "server/app/config_check.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>

#include "server/app/reload.h"
#include "tests/support/certificates.h"

namespace palpate {
namespace {

using Keys = std::vector<std::string>;

class ConfigCheckTest : public ::testing::Test, protected test::Certificates {
 protected:
  // Every fault as FILE:LINE: KEY ..., without the folder; none: it is fit.
  Keys Faults(const std::string& text, const ConfigOverrides& overrides = {},
              ConfigUse use = ConfigUse::kStart) const {
    std::ofstream(In("f.toml")) << text;
    try {
      LoadConfig(In("f.toml"), overrides, use);
      return {};
    } catch (const ConfigError& error) {
      EXPECT_EQ(error.what(), error.lines().front());
      first_kind_ = error.kind();
      Keys lines = error.lines();
      const std::string folder = In("").string();
      for (std::string& line : lines) {
        for (auto at = line.find(folder); at != line.npos; at = line.find(folder)) {
          line.erase(at, folder.size());
        }
      }
      return lines;
    }
  }
  // [tls] with these files of the folder; an empty name: not given.
  std::string Tls(const std::string& certificate, const std::string& key,
                  const std::string& ca = "", const std::string& tokens = "") const {
    std::string text = "[tls]\n";
    const auto append = [&](const char* name, const std::string& file) {
      text += (file.empty() ? "# " : "") + std::string(name) + " = \"" + In(file).string() + "\"\n";
    };
    append("certificate", certificate);
    append("key", key);
    append("client_ca", ca);
    append("tokens", tokens);
    return text + (ca.empty() ? "" : "[[tls.client]]\nsan = \"a\"\nrole = \"viewer\"\n");
  }
  void MakeGoodFiles() const {
    MakeAuthority("lab");
    Issue("lab", "server", "DNS:localhost");
    std::ofstream(In("tokens.toml")) << "";
    chmod(In("tokens.toml").c_str(), 0640);
  }

  mutable ErrorKind first_kind_ = ErrorKind::kInternal;
};

// Of each line, in their order: its beginning, and what follows later after " ... ".
void ExpectFaults(const Keys& lines, const Keys& expected) {
  ASSERT_EQ(lines.size(), expected.size()) << ::testing::PrintToString(lines);
  for (std::size_t n = 0; n < lines.size(); ++n) {
    const auto gap = expected[n].find(" ... ");
    EXPECT_TRUE(lines[n].starts_with(expected[n].substr(0, gap))) << lines[n];
    EXPECT_EQ(lines[n].find('\n'), std::string::npos);
    if (gap == std::string::npos) continue;
    EXPECT_NE(lines[n].find(expected[n].substr(gap + 5)), std::string::npos) << lines[n];
  }
}

TEST_F(ConfigCheckTest, EachFileOfTlsIsJudgedAtItsKey) {
  ExpectFaults(Faults(Tls("c.pem", "k.pem", "ca.pem", "t.toml")),
               {"f.toml:2: tls.certificate: ... c.pem", "f.toml:3: tls.key: ... k.pem",
                "f.toml:4: tls.client_ca: ... ca.pem", "f.toml:5: tls.tokens: ... t.toml"});
  EXPECT_EQ(first_kind_, ErrorKind::kNotFound);
  MakeGoodFiles();
  EXPECT_EQ(Faults(Tls("server.pem", "server.key", "lab.pem", "tokens.toml") +
                   "[server]\nlisten = \"0.0.0.0:7400\"\n"),
            Keys());
  Issue("lab", "old", "DNS:localhost", -1);
  chmod(In("old.key").c_str(), 0644);
  chmod(In("tokens.toml").c_str(), 0666);
  ExpectFaults(
      Faults(Tls("old.pem", "old.key", "server.key", "tokens.toml")),
      {"f.toml:2: tls.certificate: old.pem ... expired", "f.toml:3: tls.key: ... by others",
       "f.toml:4: tls.client_ca: server.key ... no certificate",
       "f.toml:5: tls.tokens: tokens.toml ... by others"});
  Issue("lab", "other", "DNS:localhost");
  ExpectFaults(Faults(Tls("server.pem", "other.key")),
               {"f.toml:3: tls.key: other.key ... server.pem"});
}

// Of keys that come together, the one that is there is blamed.
TEST_F(ConfigCheckTest, KeysThatNeedEachOther) {
  MakeGoodFiles();
  ExpectFaults(Faults("haptics.layer = [{name = 'a', isovalue = 1}]\nhaptics.free_side = 'above'"),
               {"f.toml:2: haptics.free_side"});
  ExpectFaults(Faults(Tls("server.pem", "")), {"f.toml:2: tls.certificate"});
  ExpectFaults(Faults(Tls("", "server.key")), {"f.toml:3: tls.key"});
  ExpectFaults(Faults(Tls("", "", "", "tokens.toml")), {"f.toml:5: tls.tokens"});
  const std::string pair = Tls("server.pem", "server.key");
  ExpectFaults(Faults(pair + "client_ca = \"" + In("lab.pem").string() + "\"\n"),
               {"f.toml:6: tls.client_ca"});
  ExpectFaults(Faults(pair + "[[tls.client]]\nsan = \"a\"\nrole = \"viewer\"\n"),
               {"f.toml:6: tls.client"});
  const std::string file = "[volume]\nsource = \"" + In("f.toml").string() + "\"\n";
  ExpectFaults(Faults(file + "raw_type = \"uint8\"\n"), {"f.toml:3: volume.raw_type "});
  ExpectFaults(Faults(file + "raw_big_endian = true\n"), {"f.toml:3: volume.raw_big_endian "});
  ExpectFaults(Faults(file + "raw_size = [2, 2, 2]\n"), {"f.toml:3: volume.raw_size "});
}

TEST_F(ConfigCheckTest, WhatOnlyFollowsIsLeftOut) {
  MakeGoodFiles();
  // Of a key that cannot be read nobody knows whether it was given.
  ExpectFaults(Faults("[tls]\ncertificate = \"" + In("server.pem").string() +
                      "\"\nkey = \"server.key\"\n[server]\nlisten = \"0.0.0.0:7400\"\n"),
               {"f.toml:3: tls.key ... absolute"});
  ExpectFaults(Faults("[server]\nlisten = \"0.0.0.0:7400\"\n[tls]\nkey = \"x\"\n"),
               {"f.toml:4: tls.key ... absolute"});
  ExpectFaults(Faults("[server]\nlisten = \"0.0.0.0:7400\"\n[tsl]\nkey = \"x\"\n"),
               {"f.toml:2: server.listen: ... TLS", "f.toml:3: tsl "});
  ExpectFaults(Faults("[volume]\nsource = 3\ndevice_mm_per_volume_mm = 1e7\n"),
               {"f.toml:2: volume.source "});
  ExpectFaults(Faults("[volume\nsource = \"/no\"\n"), {"f.toml:1: "});
}

TEST_F(ConfigCheckTest, AddressesToListenOn) {
  MakeGoodFiles();
  const std::string tls = Tls("server.pem", "server.key", "", "tokens.toml");
  const auto server = [&](const std::string& address) {
    return Faults("[server]\nlisten = \"" + address + "\"\n" + tls);
  };
  ExpectFaults(server("lab.example:7400"), {"f.toml:2: server.listen: ... lab.example:7400"});
  for (const char* address : {"localhost:7400", "[::]:7400", "192.0.2.1:7400"}) {
    EXPECT_EQ(server(address), Keys());
  }
  // A name may resolve to anything, whatever it starts with.
  for (const std::string address :
       {"0.0.0.0:7400", "127.example:7400", "[::]:7400", "10.0.0.1:7400"}) {
    const std::string listen = "[server]\nlisten = \"" + address + "\"\n";
    ExpectFaults(Faults(listen), {"f.toml:2: server.listen: ... on " + address + ": without TLS"});
    ExpectFaults(Faults(listen + Tls("server.pem", "server.key")),
                 {"f.toml:2: server.listen: ... tls.tokens"});
  }
  // Metrics are for loopback alone.
  const auto metrics = [&](const std::string& address) {
    return Faults("[metrics]\nlisten = \"" + address + "\"\n");
  };
  for (const std::string address :
       {"0.0.0.0:9464", "[::]:9464", "192.0.2.1:9464", "example.org:9464"}) {
    ExpectFaults(metrics(address), {"f.toml:2: metrics.listen: ... " + address});
  }
  for (const char* address : {"127.0.0.1:9464", "[::1]:9464", "localhost:9464"}) {
    EXPECT_EQ(metrics(address), Keys());
  }
}

TEST_F(ConfigCheckTest, NumbersOfTheVolumeHaveRanges) {
  const std::string file = "source = \"" + In("f.toml").string() + "\"\n";
  const auto faults = [&](const std::string& lines) { return Faults("[volume]\n" + lines); };
  for (const char* bad : {"0", "-1", "nan", "inf", "1e-5", "1e7"}) {
    const std::string triple = "spacing_mm = [1, " + std::string(bad) + ", 1]\n";
    ExpectFaults(faults(triple), {"f.toml:2: volume.spacing_mm: "});
    // Of most scales nobody knows then.
    EXPECT_EQ(faults(triple + "device_mm_per_volume_mm = 1e7\n").size(), 1u);
    EXPECT_EQ(faults(triple + "device_mm_per_volume_mm = -1\n").size(), 2u);
  }
  for (const char* bad : {"0", "-1", "nan", "inf", "1e-13", "1e11"}) {
    const std::string scale = "device_mm_per_volume_mm = " + std::string(bad) + "\n";
    ExpectFaults(faults(file + scale), {"f.toml:3: volume.device_mm_per_volume_mm: "});
  }
  for (const char* bad : {"nan", "inf", "-inf"}) {
    ExpectFaults(faults("isovalue = " + std::string(bad) + "\n"),
                 {"f.toml:2: volume.isovalue ... finite"});
    ExpectFaults(faults("normalized_isovalue = " + std::string(bad) + "\n"),
                 {"f.toml:2: volume.normalized_isovalue: "});
  }
  // An integer that no double holds exactly is a number all the same.
  EXPECT_EQ(faults("isovalue = 9007199254740993\n"), Keys());
  EXPECT_EQ(faults("isovalue = -1024\nspacing_mm = [1e-4, 1, 1e6]\n"), Keys());
}

// A voxel of the volume must be one that can be felt, whichever spacing it has.
TEST_F(ConfigCheckTest, AScaleIsJudgedBySpacing) {
  const auto fits = [&](const std::string& source, const std::string& more) {
    return Faults("[volume]\nsource = \"" + source + "\"\n" + more).empty();
  };
  const std::string file = In("f.toml").string();
  EXPECT_TRUE(fits(file, "device_mm_per_volume_mm = 1e7\n"));
  EXPECT_FALSE(fits("builtin:sphere", "device_mm_per_volume_mm = 1e7\n"));
  EXPECT_TRUE(fits("builtin:sphere", "device_mm_per_volume_mm = 1e5\n"));
  EXPECT_FALSE(fits(file, "device_mm_per_volume_mm = 1e5\nspacing_mm = [1, 1, 100]\n"));
  EXPECT_TRUE(fits(file, "device_mm_per_volume_mm = 1e-9\n"));
  EXPECT_FALSE(fits(file, "device_mm_per_volume_mm = 1e-9\nspacing_mm = [1, 1, 1]\n"));
}

// One fault each, at its line and key.
TEST_F(ConfigCheckTest, LooksAtTheWhole) {
  EXPECT_EQ(Faults(""), Keys());
  const std::string replay = "[device]\nkind = \"replay\"\nreplay_file = \"";
  for (const auto& [text, fault] : std::vector<std::pair<std::string, std::string>>{
           {"[volume]\nsource = \"/no/such.nrrd\"\n", "2: volume.source: "},
           {"[volume]\nsource = \"builtin:cube\"\n", "2: volume.source: "},
           {"[volume]\nframe = 1\n", "2: volume.frame "},
           {"[volume]\ngrid = \"density\"\n", "2: volume.grid "},
           {"[volume]\nload_folders = [\"/tmp\", \"/no/such\"]\n", "2: volume.load_folders: "},
           {"[volume]\nsave_folders = [\"tmp\"]\n", "2: volume.save_folders: "},
           {"[volume]\nupload_folder = \"\"\n", "2: volume.upload_folder: "},
           {"[volume]\nupload_folder = \"/no/such\"\n", "2: volume.upload_folder: "},
           {"[volume]\nisovalue = 1\nnormalized_isovalue = 0.1\n",
            "3: volume.normalized_isovalue "},
           {"[volume]\nnormalized_isovalue = 1.5\n", "2: volume.normalized_isovalue: "},
           {"[device]\n\nkind = \"omni\"\n", "3: device.kind: "},
           {"[device]\nkind = \"replay\"\n", "2: device.kind: "},
           {"[device]\nframes = \"framed-firewire\"\n", "2: device.frames ... openhaptics"},
           {"[device]\nstop_buttons = 12\n", "2: device.stop_buttons: "},
           {replay + "/no/such\"\n", "3: device.replay_file: ... /no/such"},
           // It is there, and no recording.
           {replay + In("f.toml").string() + "\"\n", "3: device.replay_file: "},
           {"[device]\nfalcon_firmware = \"/no/such\"\n", "2: device.falcon_firmware: "},
           {"[haptics]\nmethod = \"tptd\"\n", "2: haptics.method "},
           {"[server]\nsocket = \"/tmp/a b\"\n", "2: server.socket: "},
           {"[realtime]\ncpu = 1023\n", "2: realtime.cpu "}}) {
    ExpectFaults(Faults(text), {"f.toml:" + fault});
  }
}

TEST_F(ConfigCheckTest, TheCommandLineIsJudgedBesideTheFile) {
  const ConfigOverrides overrides = {{"--volume", "volume.source", "/no/such.nrrd"},
                                     {"--stiffness-n-per-mm", "haptics.stiffness_n_per_mm", 50.0},
                                     {"--log-level", "log.level", "loud"},
                                     {"--method", "haptics.method", "mc33"}};
  ExpectFaults(Faults("[volume]\nsource = 3\n[haptics]\nstiff = 1\n", overrides),
               {"--stiffness-n-per-mm ", "--log-level ", "--method ", "f.toml:2: volume.source ",
                "f.toml:4: haptics.stiff "});
  ExpectFaults(
      Faults("[volume]\nsource = \"/of/the/file\"\n", overrides),
      {"--stiffness-n-per-mm ", "--log-level ", "--method ", "--volume: ... /no/such.nrrd"});
  ExpectFaults(Faults("", {{"--volume", "volume.source", ""}}), {"--volume must"});
  ExpectFaults(
      Faults("", {{"--load-folder", "volume.load_folders", std::vector<std::string>{"/tmp", ""}}}),
      {"--load-folder"});
  ExpectFaults(Faults("", {{"--raw-type", "volume.raw_type", "uint8"}}), {"--raw-type "});
}

TEST_F(ConfigCheckTest, TheCommandLineStandsInPlaceOfTheFile) {
  std::ofstream(In("f.toml")) << "[volume]\nsource = \"" + In("f.toml").string() +
                                     "\"\nisovalue = 0.5\n"
                                     "spacing_mm = [2, 2, 2]\nframe = 1\nmax_upload_mib = 3\n"
                                     "[haptics]\npop_force_n = 1\n";
  const auto load = [&](const ConfigOverrides& overrides) {
    return LoadConfig(In("f.toml"), overrides);
  };
  EXPECT_EQ(load({}).config.volume.isovalue, 0.5);
  // Another isovalue, in its other form.
  const LoadedConfig isovalue =
      load({{"--normalized-isovalue", "volume.normalized_isovalue", 0.25}});
  EXPECT_FALSE(isovalue.config.volume.isovalue);
  EXPECT_EQ(isovalue.config.volume.normalized_isovalue, 0.25);
  EXPECT_EQ(isovalue.config.volume.spacing_mm, Vec3(2, 2, 2));
  // Another volume has nothing of the file's.
  const LoadedConfig other =
      load({{"--volume", "volume.source", "builtin:sphere"},
            {"--spacing-mm", "volume.spacing_mm", std::vector<double>{1.0, 1.0, 3.0}},
            {"--load-folder", "volume.load_folders", std::vector<std::string>{"/tmp"}}});
  EXPECT_EQ(other.config.volume.source, "builtin:sphere");
  EXPECT_FALSE(other.config.volume.isovalue || other.config.volume.frame);
  EXPECT_EQ(other.config.volume.spacing_mm, Vec3(1, 1, 3));
  EXPECT_EQ(other.config.load_folders, std::vector<std::filesystem::path>{"/tmp"});
  // A reload looks at the file's keys only.
  ASSERT_EQ(other.keys.size(), 2u);
  EXPECT_TRUE(other.keys.contains("volume.max_upload_mib"));
  EXPECT_TRUE(other.keys.contains("haptics.pop_force_n"));
}

TEST_F(ConfigCheckTest, WhatTurnsOutLaterNamesItsLineToo) {
  std::ofstream(In("f.toml")) << "[volume]\nisovalue = 7\n";
  const LoadedConfig loaded = LoadConfig(In("f.toml"));
  const Error error(ErrorKind::kConflict, "too much");
  EXPECT_EQ(AtKey(loaded, "volume.isovalue", error).what(),
            In("f.toml").string() + ":2: volume.isovalue: too much");
  EXPECT_EQ(AtKey(loaded, "volume.isovalue", error).kind(), ErrorKind::kConflict);
  // Of the command line, or by default.
  EXPECT_STREQ(AtKey(loaded, "volume.source", error).what(), "too much");
}

TEST_F(ConfigCheckTest, AReloadDoesNotNeedWhatWasReadAtTheStart) {
  const std::string gone = "\"" + In("gone.nrrd").string() + "\"\n";
  for (const std::string& text :
       {"[volume]\nsource = " + gone, std::string("[volume]\nload_folders = [\"/gone\"]\n"),
        "[device]\nkind = \"replay\"\nreplay_file = " + gone,
        "[device]\nkind = \"falcon\"\nfalcon_firmware = " + gone}) {
    EXPECT_NE(Faults(text), Keys()) << text;
    EXPECT_EQ(Faults(text, {}, ConfigUse::kReload), Keys()) << text;
  }
  // What a reload takes over is looked at.
  EXPECT_NE(Faults("[tls]\nkey = " + gone, {}, ConfigUse::kReload), Keys());
}

ConfigKeys KeysOf(const std::string& text) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "f.toml") << text;
  Config config;
  return ReadConfig(folder.path() / "f.toml", {}, config).keys;
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
  EXPECT_FALSE(update.isovalue || update.normalized_isovalue || !update.choices.empty());
  // An isovalue that is taken out stays until the next load.
  EXPECT_FALSE(UpdateOf({"volume.isovalue"}, config).normalized_isovalue);
  config.volume.isovalue = 300.0;
  EXPECT_EQ(UpdateOf({"volume.isovalue"}, config).isovalue, 300.0);
  EXPECT_FALSE(UpdateOf({"volume.isovalue"}, config).normalized_isovalue);
}

}  // namespace
}  // namespace palpate
