// What a whole configuration is refused for: at --check-config, at start, at a reload.
#include "server/app/config_check.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>

#include "tests/support/certificates.h"

namespace palpate {
namespace {

using Keys = std::vector<std::string>;

class ConfigCheckTest : public ::testing::Test, protected test::Certificates {
 protected:
  // Every fault as FILE:LINE: KEY ..., without the folder; none: it is fit.
  Keys Faults(
      const std::string& text, const ConfigMerge& merge = [](LoadedConfig&) {},
      ConfigUse use = ConfigUse::kStart) const {
    std::ofstream(In("f.toml")) << text;
    try {
      LoadConfig(In("f.toml"), merge, use);
      return {};
    } catch (const ConfigError& error) {
      EXPECT_EQ(error.what(), error.lines().front());
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
  ErrorKind KindOf(const std::string& text) const {
    std::ofstream(In("f.toml")) << text;
    try {
      LoadConfig(In("f.toml"), [](LoadedConfig&) {});
    } catch (const ConfigError& error) {
      return error.kind();
    }
    return ErrorKind::kInternal;
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
};

// The beginnings of all lines, in their order.
void ExpectBeginnings(const Keys& lines, const Keys& beginnings) {
  ASSERT_EQ(lines.size(), beginnings.size()) << ::testing::PrintToString(lines);
  for (std::size_t n = 0; n < lines.size(); ++n) {
    EXPECT_TRUE(lines[n].starts_with(beginnings[n])) << lines[n];
    EXPECT_EQ(lines[n].find('\n'), std::string::npos);
  }
}

TEST_F(ConfigCheckTest, FilesOfTlsThatAreFitAreTaken) {
  MakeGoodFiles();
  EXPECT_EQ(Faults(Tls("server.pem", "server.key", "lab.pem", "tokens.toml") +
                   "[server]\nlisten = \"0.0.0.0:7400\"\n"),
            Keys());
}

TEST_F(ConfigCheckTest, EveryFileOfTlsThatIsMissingIsNamed) {
  const std::string text = Tls("c.pem", "k.pem", "ca.pem", "t.toml");
  ExpectBeginnings(Faults(text), {"f.toml:2: tls.certificate: cannot read c.pem",
                                  "f.toml:3: tls.key: cannot read k.pem: No such file",
                                  "f.toml:4: tls.client_ca: cannot read ca.pem",
                                  "f.toml:5: tls.tokens: cannot read t.toml: No such file"});
  EXPECT_EQ(KindOf(text), ErrorKind::kNotFound);
}

TEST_F(ConfigCheckTest, EveryFileOfTlsThatIsNotFitIsNamed) {
  MakeGoodFiles();
  Issue("lab", "old", "DNS:localhost", -1);
  chmod(In("old.key").c_str(), 0644);
  chmod(In("tokens.toml").c_str(), 0666);
  ExpectBeginnings(Faults(Tls("old.pem", "old.key", "server.key", "tokens.toml")),
                   {"f.toml:2: tls.certificate: old.pem has expired",
                    "f.toml:3: tls.key: the key old.key may be read or written by others",
                    "f.toml:4: tls.client_ca: server.key holds no certificate",
                    "f.toml:5: tls.tokens: tokens.toml may be written by others"});
  std::ofstream(In("tokens.toml")) << "[[token]]\nname = 3\n";
  chmod(In("tokens.toml").c_str(), 0600);
  ExpectBeginnings(Faults(Tls("server.pem", "server.key", "", "tokens.toml")),
                   {"f.toml:5: tls.tokens: tokens.toml:1: a token needs its name"});
}

TEST_F(ConfigCheckTest, APairThatDoesNotBelongTogetherIsRefused) {
  MakeGoodFiles();
  Issue("lab", "other", "DNS:localhost");
  ExpectBeginnings(Faults(Tls("server.pem", "other.key")),
                   {"f.toml:3: tls.key: other.key is not the key of server.pem: set"});
  // As people copy them: one for the other.
  chmod(In("server.pem").c_str(), 0600);
  ExpectBeginnings(Faults(Tls("server.key", "server.pem")),
                   {"f.toml:2: tls.certificate: server.key holds no certificate",
                    "f.toml:3: tls.key: server.pem holds no key"});
}

TEST_F(ConfigCheckTest, WhatOnlyFollowsIsLeftOut) {
  MakeGoodFiles();
  // Of a key that cannot be read nobody knows whether it was given.
  ExpectBeginnings(Faults("[tls]\ncertificate = \"" + In("server.pem").string() +
                          "\"\nkey = \"server.key\"\n[server]\nlisten = \"0.0.0.0:7400\"\n"),
                   {"f.toml:3: tls.key must be an absolute path"});
  ExpectBeginnings(Faults("[server]\nlisten = \"0.0.0.0:7400\"\n[tls]\nkey = \"x\"\n"),
                   {"f.toml:4: tls.key must be an absolute path"});
  ExpectBeginnings(Faults("[server]\nlisten = \"0.0.0.0:7400\"\n[tsl]\nkey = \"x\"\n"),
                   {"f.toml:2: server.listen: will not listen on 0.0.0.0:7400: without TLS only",
                    "f.toml:3: tsl is no table"});
  ExpectBeginnings(Faults("[volume]\nsource = 3\ndevice_mm_per_volume_mm = 1e7\n"),
                   {"f.toml:2: volume.source must be a text"});
  ExpectBeginnings(Faults("[volume\nsource = \"/no\"\n"), {"f.toml:1: "});
}

TEST_F(ConfigCheckTest, ANameIsNoAddressToListenOn) {
  MakeGoodFiles();
  const std::string tls = Tls("server.pem", "server.key", "", "tokens.toml");
  ExpectBeginnings(Faults("[server]\nlisten = \"lab.example:7400\"\n" + tls),
                   {"f.toml:2: server.listen: cannot listen on lab.example:7400: give an address"});
  for (const char* address : {"localhost:7400", "[::]:7400", "192.0.2.1:7400"}) {
    EXPECT_EQ(Faults("[server]\nlisten = \"" + std::string(address) + "\"\n" + tls), Keys());
  }
}

TEST_F(ConfigCheckTest, MetricsAreForLoopbackAlone) {
  for (const char* address : {"0.0.0.0:9464", "[::]:9464", "192.0.2.1:9464", "example.org:9464"}) {
    ExpectBeginnings(Faults("[metrics]\nlisten = \"" + std::string(address) + "\"\n"),
                     {"f.toml:2: metrics.listen: will not listen on " + std::string(address)});
  }
  for (const char* address : {"127.0.0.1:9464", "[::1]:9464", "localhost:9464"}) {
    EXPECT_EQ(Faults("[metrics]\nlisten = \"" + std::string(address) + "\"\n"), Keys());
  }
}

TEST_F(ConfigCheckTest, NumbersOfTheVolumeHaveRanges) {
  const std::string file = "source = \"" + In("f.toml").string() + "\"\n";
  const auto faults = [&](const std::string& lines) { return Faults("[volume]\n" + lines); };
  for (const char* bad : {"0", "-1", "nan", "inf", "1e-5", "1e7"}) {
    const std::string triple = "spacing_mm = [1, " + std::string(bad) + ", 1]\n";
    ExpectBeginnings(faults(triple), {"f.toml:2: volume.spacing_mm: voxel spacing "});
    // Of most scales nobody knows then.
    EXPECT_EQ(faults(triple + "device_mm_per_volume_mm = 1e7\n").size(), 1u);
    EXPECT_EQ(faults(triple + "device_mm_per_volume_mm = -1\n").size(), 2u);
  }
  for (const char* bad : {"0", "-1", "nan", "inf", "1e-13", "1e11"}) {
    const std::string scale = "device_mm_per_volume_mm = " + std::string(bad) + "\n";
    ExpectBeginnings(faults(file + scale),
                     {"f.toml:3: volume.device_mm_per_volume_mm: the scale must make a voxel"});
  }
  for (const char* bad : {"nan", "inf", "-inf"}) {
    ExpectBeginnings(faults("isovalue = " + std::string(bad) + "\n"),
                     {"f.toml:2: volume.isovalue must be a finite number"});
    ExpectBeginnings(faults("normalized_isovalue = " + std::string(bad) + "\n"),
                     {"f.toml:2: volume.normalized_isovalue: normalized isovalue "});
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

TEST_F(ConfigCheckTest, ARecordingToReplayMustBeThere) {
  const std::string text = "[device]\nkind = \"replay\"\nreplay_file = ";
  ExpectBeginnings(Faults(text + "\"/no/such\"\n"), {"f.toml:3: device.replay_file: cannot read"});
  // It is there, and none.
  ExpectBeginnings(Faults(text + "\"" + In("f.toml").string() + "\"\n"),
                   {"f.toml:3: device.replay_file: "});
}

TEST_F(ConfigCheckTest, TheCommandLineIsJudgedBesideTheFile) {
  const auto merge = [](LoadedConfig& loaded) {
    loaded.keys.erase("volume.source");
    loaded.config.volume = "/no/such.nrrd";
    loaded.config.haptics.stiffness_n_per_mm = 50.0;
    loaded.config.log_level = "loud";
    throw Error(ErrorKind::kInvalidArgument, "unknown method mc33");
  };
  ExpectBeginnings(Faults("[volume]\nsource = \"/of/the/file\"\n[haptics]\nstiff = 1\n", merge),
                   {"unknown method mc33", "volume.source: cannot read /no/such.nrrd",
                    "haptics.stiffness_n_per_mm: stiffness_n_per_mm 50 is not within 0 to 3 N/mm",
                    "log.level must be", "f.toml:4: haptics.stiff is no setting of palpated"});
}

TEST_F(ConfigCheckTest, WhatTurnsOutLaterNamesItsLineToo) {
  std::ofstream(In("f.toml")) << "[volume]\nisovalue = 7\n";
  const LoadedConfig loaded = LoadConfig(In("f.toml"), [](LoadedConfig&) {});
  const Error error(ErrorKind::kConflict, "too much");
  EXPECT_EQ(AtKey(loaded, "volume.isovalue", error).what(),
            In("f.toml").string() + ":2: volume.isovalue: too much");
  EXPECT_EQ(AtKey(loaded, "volume.isovalue", error).kind(), ErrorKind::kConflict);
  // Of the command line, or by default.
  EXPECT_STREQ(AtKey(loaded, "volume.source", error).what(), "too much");
}

TEST_F(ConfigCheckTest, AReloadDoesNotNeedWhatWasReadAtTheStart) {
  const std::string gone = In("gone.nrrd").string();
  for (const std::string& text :
       {"[volume]\nsource = \"" + gone + "\"\n",
        "[device]\nkind = \"replay\"\nreplay_file = \"" + gone + "\"\n",
        "[device]\nkind = \"falcon\"\nfalcon_firmware = \"" + gone + "\"\n"}) {
    EXPECT_FALSE(Faults(text).empty()) << text;
    EXPECT_EQ(Faults(
                  text, [](LoadedConfig&) {}, ConfigUse::kReload),
              Keys())
        << text;
  }
  // What a reload takes over is looked at.
  EXPECT_EQ(Faults(
                "[tls]\nkey = \"" + gone + "\"\n", [](LoadedConfig&) {}, ConfigUse::kReload)
                .empty(),
            false);
}

}  // namespace
}  // namespace palpate
