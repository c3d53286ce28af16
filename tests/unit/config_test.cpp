// The configuration file.
#include "server/app/config.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "common/error/error.h"
#include "tests/support/places.h"

namespace palpate {
namespace {

class ConfigTest : public ::testing::Test {
 protected:
  void SetUp() override {
    char name[] = "/tmp/palpate-config-XXXXXX";
    ASSERT_NE(mkdtemp(name), nullptr);
    folder_ = name;
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  Config Read(const std::string& text) const {
    std::ofstream(folder_ / "palpated.toml") << text;
    Config config;
    const ConfigReading reading = ReadConfig(folder_ / "palpated.toml", config);
    if (reading.faults.empty()) return config;
    const ConfigFault& first = reading.faults.front();
    throw Error(first.kind, ToText(folder_ / "palpated.toml", first));
  }
  std::string Refusal(const std::string& text) const {
    try {
      Read(text);
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInvalidArgument);
      return error.what();
    }
    return "accepted";
  }

  std::filesystem::path folder_;
};

TEST_F(ConfigTest, ReadsEveryKey) {
  const Config config = Read(R"(
[volume]
source = "/data/head.nrrd"
isovalue = 300
spacing_mm = [1, 1.0, 2.5]
device_mm_per_volume_mm = 0.5
load_folders = ["/tmp", "/"]
save_folders = []
memory_budget_mib = 300
max_upload_mib = 200
upload_vdb = false
upload_folder = "/tmp"
[metrics]
listen = "127.0.0.1:9464"
[haptics]
stiffness_n_per_mm = 0.8
damping_n_s_per_m = 2
static_friction = 0.4
dynamic_friction = 0.3
viscosity_n_s_per_m = 1.5
pop_force_n = 2.5
magnet_force_n = 0.5
magnet_range_mm = 3
force_shading = true
passivity_control = true
free_side = "above"
method = "bcc"
[device]
kind = "simulated"
pressed_buttons = 3
stop_buttons = 2
replay_file = "/data/path.palpate"
usb_port = "1-2"
frames = "framed-firewire"
state_command = 0x21
force_command = 34
init_payload = [0x01, 0xff]
motor_counts_per_n_mm = [1, -2.5, 3]
falcon_firmware = "/opt/falcon.bin"
openhaptics_library = "/opt/libHD.so"
openhaptics_name = "Left"
[server]
socket = "/tmp/s.sock"
listen = "127.0.0.1:7400"
[realtime]
priority = 70
cpu = 1
lock_memory = false
[state]
folder = "/var/lib/palpate"
[log]
level = "warning"
)");
  EXPECT_EQ(config.volume, "/data/head.nrrd");
  EXPECT_EQ(config.isovalue, 300.0);
  EXPECT_EQ(*config.spacing_mm, Vec3(1.0, 1.0, 2.5));
  EXPECT_EQ(config.device_mm_per_volume_mm, 0.5);
  EXPECT_EQ(*config.load_folders, (std::vector<std::filesystem::path>{"/tmp", "/"}));
  EXPECT_TRUE(config.save_folders && config.save_folders->empty());
  EXPECT_EQ(config.memory_budget_bytes, std::uint64_t{300} << 20);
  EXPECT_EQ(config.uploads.max_bytes, std::uint64_t{200} << 20);
  EXPECT_EQ(config.uploads.folder, "/tmp");
  EXPECT_FALSE(config.uploads.vdb);
  EXPECT_EQ(config.haptics.stiffness_n_per_mm, 0.8);
  EXPECT_EQ(config.haptics.damping_n_s_per_m, 2.0);
  EXPECT_EQ(config.haptics.static_friction, 0.4);
  EXPECT_EQ(config.haptics.dynamic_friction, 0.3);
  EXPECT_EQ(config.haptics.viscosity_n_s_per_m, 1.5);
  EXPECT_EQ(config.haptics.pop_force_n, 2.5);
  EXPECT_EQ(config.haptics.magnet_force_n, 0.5);
  EXPECT_EQ(config.haptics.magnet_range_mm, 3.0);
  EXPECT_TRUE(config.haptics.force_shading);
  EXPECT_TRUE(config.haptics.passivity_control);
  EXPECT_EQ(config.haptics.free_side, FreeSide::kAbove);
  EXPECT_EQ(config.method, DecompositionMethod::kBcc);
  EXPECT_EQ(config.listen->port, 7400);
  EXPECT_EQ(config.metrics_listen->port, 9464);
  EXPECT_EQ(config.device.pressed_buttons, 3);
  EXPECT_EQ(config.device.stop_buttons, 2u);
  EXPECT_EQ(config.device.replay_file, "/data/path.palpate");
  EXPECT_EQ(config.device.usb_port, "1-2");
  EXPECT_TRUE(config.device.framed_firewire);
  EXPECT_EQ(config.device.state_command, 0x21);
  EXPECT_EQ(config.device.force_command, 34);
  EXPECT_EQ(config.device.init_payload, (std::vector<std::uint8_t>{1, 255}));
  EXPECT_EQ(config.device.motor_counts_per_n_mm, (std::array<double, 3>{1.0, -2.5, 3.0}));
  EXPECT_EQ(config.device.falcon_firmware, "/opt/falcon.bin");
  EXPECT_EQ(config.device.openhaptics_library, "/opt/libHD.so");
  EXPECT_EQ(config.device.openhaptics_name, "Left");
  EXPECT_EQ(config.realtime.priority, 70);
  EXPECT_FALSE(config.realtime.lock_memory);
  EXPECT_EQ(config.state_folder, "/var/lib/palpate");
  EXPECT_EQ(config.log_level, "warning");
}

// The file that users start from: every key of [haptics], with its default.
TEST_F(ConfigTest, TheShippedFileHasEverySettingAtItsDefault) {
  std::ostringstream text;
  text << std::ifstream(test::kExampleConfig).rdbuf();
  Config config = Read(text.str());
  const HapticSettings defaults;
  for (const NumberSetting& setting : kNumberSettings) {
    EXPECT_EQ(config.haptics.*setting.member, defaults.*setting.member) << setting.key;
    EXPECT_NE(text.str().find("\n" + std::string(setting.key) + " = "), std::string::npos)
        << setting.key;
    const std::string range =
        fmt::format("{:g} to {:g}{}", setting.low, setting.high, setting.unit);
    EXPECT_NE(text.str().find(range), std::string::npos) << setting.key << " " << range;
  }
  for (const FlagSetting& setting : kFlagSettings) {
    EXPECT_EQ(config.haptics.*setting.member, defaults.*setting.member) << setting.key;
    EXPECT_NE(text.str().find("\n" + std::string(setting.key) + " = "), std::string::npos)
        << setting.key;
  }
  EXPECT_NE(text.str().find("\nfree_side = \"below\""), std::string::npos);
  EXPECT_EQ(config.haptics.free_side, defaults.free_side);
}

TEST_F(ConfigTest, ReadsSecurity) {
  const SecurityOptions security = Read(R"(
[server]
socket_role = "editor"
loopback_role = "viewer"
[tls]
certificate = "/c.pem"
key = "/k.pem"
client_ca = "/ca.pem"
tokens = "/t.toml"
[[tls.client]]
san = "a.example"
role = "operator"
[[tls.client]]
san = "spiffe://b"
role = "admin"
[limits]
connections = 1
calls_per_s = 2
pose_streams = 3
pose_samples_per_s = 2000
volume_streams = 4
transfers = 5
)")
                                       .security;
  EXPECT_EQ(security.policy.socket_role, Role::kEditor);
  EXPECT_EQ(security.policy.loopback_role, Role::kViewer);
  EXPECT_EQ(security.tls.certificate, "/c.pem");
  EXPECT_EQ(security.tls.key, "/k.pem");
  EXPECT_EQ(security.policy.client_ca, "/ca.pem");
  EXPECT_EQ(security.policy.tokens, "/t.toml");
  ASSERT_EQ(security.policy.clients.size(), 2u);
  EXPECT_EQ(security.policy.clients[1].san, "spiffe://b");
  EXPECT_EQ(security.policy.clients[1].role, Role::kAdmin);
  EXPECT_EQ(security.connections, 1);
  EXPECT_EQ(security.limits.calls_per_s, 2);
  EXPECT_EQ(security.limits.pose_streams, 3);
  EXPECT_EQ(security.limits.pose_samples_per_s, 2000);
  EXPECT_EQ(security.limits.volume_streams, 4);
  EXPECT_EQ(security.limits.transfers, 5);
}

TEST_F(ConfigTest, SecurityThatCannotWorkIsRefused) {
  const std::string pair = "[tls]\ncertificate = \"/c\"\nkey = \"/k\"\n";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"[server]\nsocket_role = \"root\"\n", ":2: server.socket_role must be"},
      {"[tls]\nkey = \"k.pem\"\n", ":2: tls.key must be an absolute path"},
      {"[tls]\nkey = \"/k\"\n", "tls.certificate and tls.key come together"},
      {"[tls]\ntokens = \"/t\"\n", "of no use without TLS"},
      {pair + "client_ca = \"/ca\"\n", "tls.client_ca and [[tls.client]] come together"},
      {pair + "[[tls.client]]\nsan = \"a\"\nrole = \"viewer\"\n", "come together"},
      {pair + "[[tls.client]]\nsan = \"a\"\n", "needs san and role"},
      {pair + "[[tls.client]]\nname = \"a\"\n", ":4: tls.client has san and role, and no name"},
      {"[tls]\nclient = 3\n", ":2: tls.client must be [[tls.client]]"},
      {"[limits]\npose_streams = 0\n", ":2: limits.pose_streams must be a whole number"},
      {"[limits]\npose_samples_per_s = 1999\n", ":2: limits.pose_samples_per_s must be a whole"},
  };
  for (const auto& [text, why] : cases) {
    EXPECT_NE(Refusal(text).find(why), std::string::npos) << text << Refusal(text);
  }
}

TEST_F(ConfigTest, WhatGoesTogetherNamesTheKeyThatIsThere) {
  const std::string pair = "[tls]\ncertificate = \"/c\"\nkey = \"/k\"\n";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"[tls]\nkey = \"/k\"\n", ":2: tls.key: tls.certificate and tls.key come"},
      {"[tls]\ncertificate = \"/c\"\n", ":2: tls.certificate: tls.certificate and"},
      {"[tls]\n\ntokens = \"/t\"\n", ":3: tls.tokens: tls.tokens and tls.client_ca"},
      {pair + "client_ca = \"/ca\"\n", ":4: tls.client_ca: tls.client_ca and [[tls.client]]"},
      {pair + "[[tls.client]]\nsan = \"a\"\nrole = \"viewer\"\n", ":4: tls.client: tls.client_ca"}};
  for (const auto& [text, why] : cases) {
    EXPECT_NE(Refusal(text).find("palpated.toml" + why), std::string::npos) << Refusal(text);
  }
}

TEST_F(ConfigTest, AnUnknownTableIsAFault) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"\n[tsl]\ncertificate = \"/c\"\n", ":2: tsl is no table of palpated: there are device, "},
      {"[tsl]\n", ":1: tsl is no table"},
      {"[log]\n[haptics.surface]\n", ":2: haptics.surface is no table"},
      {"[log]\n[volume.source]\nname = 1\n", ":2: volume.source is no table"},
      {"[[haptics]]\nmethod = \"bcc\"\n", ":1: haptics is no setting"},
      {"log = \"info\"\n", ":1: log is no setting"}};
  for (const auto& [text, why] : cases) {
    EXPECT_NE(Refusal(text).find("palpated.toml" + why), std::string::npos) << Refusal(text);
  }
}

TEST_F(ConfigTest, FoldersMustBeThere) {
  for (const char* bad : {"\"/tmp\"", "1", "[1]", "[\"/tmp\", true]", "[\"tmp\"]", "[\"\"]",
                          "[\"/tmp\", \"/no/such/folder\"]", "[\"/etc/passwd\"]"}) {
    for (const std::string& key : {std::string("load_folders"), std::string("save_folders")}) {
      EXPECT_NE(
          Refusal("[volume]\n" + key + " = " + bad + "\n").find("palpated.toml:2: volume." + key),
          std::string::npos)
          << bad;
    }
  }
}

TEST_F(ConfigTest, TheUploadFolderMustBeThere) {
  for (const char* bad : {"\"\"", "\"tmp\"", "\"/no/such\"", "1", "[\"/tmp\"]"}) {
    EXPECT_NE(Refusal("[volume]\nupload_folder = " + std::string(bad) + "\n")
                  .find("palpated.toml:2: volume.upload_folder"),
              std::string::npos)
        << bad;
  }
}

TEST_F(ConfigTest, SizesAreWholeNumbersAboveZero) {
  EXPECT_GT(Read("").memory_budget_bytes, 0u);
  for (const char* bad : {"0", "-1", "1.5", "\"1\"", "true", "1073741825", "[1]"}) {
    EXPECT_NE(Refusal("[volume]\nmax_upload_mib = " + std::string(bad) + "\n")
                  .find("palpated.toml:2: volume.max_upload_mib"),
              std::string::npos)
        << bad;
    EXPECT_NE(Refusal("[volume]\nmemory_budget_mib = " + std::string(bad) + "\n")
                  .find("palpated.toml:2: volume.memory_budget_mib"),
              std::string::npos)
        << bad;
  }
}

TEST_F(ConfigTest, NamesTheLineOfAnError) {
  EXPECT_NE(Refusal("[haptics]\n\nstiffness = 1\n").find("palpated.toml:3: haptics.stiffness"),
            std::string::npos);
  EXPECT_NE(Refusal("[realtime]\npriority = 200\n").find(":2: realtime.priority must be"),
            std::string::npos);
  EXPECT_NE(Refusal("[volume]\nspacing_mm = [1, 2]\n").find(":2: volume.spacing_mm"),
            std::string::npos);
  EXPECT_NE(Refusal("[haptics]\nmethod = \"mc33\"\n").find(":2: haptics.method"),
            std::string::npos);
  EXPECT_NE(
      Refusal("[haptics]\nforce_shading = 1\n").find(":2: haptics.force_shading must be true"),
      std::string::npos);
  EXPECT_NE(
      Refusal("[haptics]\npop_force_n = true\n").find(":2: haptics.pop_force_n must be a num"),
      std::string::npos);
  EXPECT_NE(
      Refusal("[haptics]\nfree_side = \"left\"\n").find(":2: haptics.free_side must be \"bel"),
      std::string::npos);
  EXPECT_NE(Refusal("[device]\nframes = \"usb\"\n").find("\"framed-firewire\""), std::string::npos);
  for (const char* bytes : {"[256]", "[1, -1]", "[1.0]", "3"}) {
    EXPECT_NE(Refusal(std::string("[device]\ninit_payload = ") + bytes + "\n").find("of bytes"),
              std::string::npos);
  }
  EXPECT_NE(Refusal("[device]\nstate_command = 256\n").find("0 to 255"), std::string::npos);
  EXPECT_NE(Refusal("[device]\npressed_buttons = 4\n").find(":2: device.pressed_buttons must"),
            std::string::npos);
  EXPECT_NE(Refusal("[state]\nfolder = 3\n").find(":2: state.folder must be a text"),
            std::string::npos);
  EXPECT_NE(Refusal("[server\n").find("palpated.toml:1:"), std::string::npos);
  EXPECT_NE(Refusal("[server]\nlisten = \"7400\"\n").find(":2: server.listen"), std::string::npos);
}

}  // namespace
}  // namespace palpate
