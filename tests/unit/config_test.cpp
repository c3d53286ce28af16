// The configuration file.
#include "server/app/config.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

class ConfigTest : public ::testing::Test {
 protected:
  Config Read(const std::string& text) const {
    Config config;
    for (const ConfigFault& fault : Faults(text, config)) ADD_FAILURE() << ToText("", fault);
    return config;
  }
  // Line and key of the first fault; empty: there is none.
  std::string FirstFault(const std::string& text) const {
    Config config;
    const std::vector<ConfigFault> faults = Faults(text, config);
    if (faults.empty()) return "";
    EXPECT_EQ(faults[0].kind, ErrorKind::kInvalidArgument) << text;
    return fmt::format("{} {}", faults[0].line, faults[0].key);
  }

 private:
  std::vector<ConfigFault> Faults(const std::string& text, Config& config) const {
    const std::filesystem::path file = folder_.path() / "palpated.toml";
    std::ofstream(file) << text;
    return ReadConfig(file, config).faults;
  }

  test::TemporaryFolder folder_;
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
free_side = "above"
method = "bcc"
[server]
socket = "/tmp/s.sock"
listen = "127.0.0.1:7400"
socket_role = "editor"
loopback_role = "viewer"
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
  EXPECT_EQ(config.metrics_listen->port, 9464);
  EXPECT_EQ(config.haptics.free_side, FreeSide::kAbove);
  EXPECT_EQ(config.method, DecompositionMethod::kBcc);
  EXPECT_EQ(config.socket_path, "/tmp/s.sock");
  EXPECT_EQ(config.listen->port, 7400);
  EXPECT_EQ(config.security.policy.socket_role, Role::kEditor);
  EXPECT_EQ(config.security.policy.loopback_role, Role::kViewer);
  EXPECT_EQ(config.realtime.priority, 70);
  EXPECT_EQ(config.realtime.cpu, 1);
  EXPECT_FALSE(config.realtime.lock_memory);
  EXPECT_EQ(config.state_folder, "/var/lib/palpate");
  EXPECT_EQ(config.log_level, "warning");
}

TEST_F(ConfigTest, ReadsEveryKeyOfWhatIsFelt) {
  for (const NumberSetting& setting : kNumberSettings) {
    const double value = setting.low + 0.25 * (setting.high - setting.low);
    const Config config = Read(fmt::format("[haptics]\n{} = {}\n", setting.key, value));
    EXPECT_EQ(config.haptics.*setting.member, value) << setting.key;
  }
  for (const FlagSetting& setting : kFlagSettings) {
    for (const bool value : {true, false}) {
      const Config config = Read(fmt::format("[haptics]\n{} = {}\n", setting.key, value));
      EXPECT_EQ(config.haptics.*setting.member, value) << setting.key;
    }
  }
}

TEST_F(ConfigTest, ReadsEveryKeyOfTheDevice) {
  const DeviceConfig device = Read(R"(
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
)")
                                  .device;
  EXPECT_EQ(device.kind, "simulated");
  EXPECT_EQ(device.pressed_buttons, 3);
  EXPECT_EQ(device.stop_buttons, 2u);
  EXPECT_EQ(device.replay_file, "/data/path.palpate");
  EXPECT_EQ(device.usb_port, "1-2");
  EXPECT_TRUE(device.framed_firewire);
  EXPECT_EQ(device.state_command, 0x21);
  EXPECT_EQ(device.force_command, 34);
  EXPECT_EQ(device.init_payload, (std::vector<std::uint8_t>{1, 255}));
  EXPECT_EQ(device.motor_counts_per_n_mm, (std::array<double, 3>{1.0, -2.5, 3.0}));
  EXPECT_EQ(device.falcon_firmware, "/opt/falcon.bin");
  EXPECT_EQ(device.openhaptics_library, "/opt/libHD.so");
  EXPECT_EQ(device.openhaptics_name, "Left");
}

// The file that users start from: every key of [haptics], with its default.
TEST_F(ConfigTest, TheShippedFileHasEverySettingAtItsDefault) {
  std::ostringstream text;
  text << std::ifstream(test::kExampleConfig).rdbuf();
  const Config config = Read(text.str());
  const auto has = [&text](const std::string& part) {
    return text.str().find(part) != std::string::npos;
  };
  const HapticSettings defaults;
  for (const NumberSetting& setting : kNumberSettings) {
    EXPECT_EQ(config.haptics.*setting.member, defaults.*setting.member) << setting.key;
    EXPECT_TRUE(has(fmt::format("\n{} = ", setting.key))) << setting.key;
    EXPECT_TRUE(has(fmt::format("{:g} to {:g}{}", setting.low, setting.high, setting.unit)))
        << setting.key;
  }
  for (const FlagSetting& setting : kFlagSettings) {
    EXPECT_EQ(config.haptics.*setting.member, defaults.*setting.member) << setting.key;
    EXPECT_TRUE(has(fmt::format("\n{} = ", setting.key))) << setting.key;
  }
  EXPECT_TRUE(has("\nfree_side = \"below\""));
  EXPECT_EQ(config.haptics.free_side, defaults.free_side);
}

TEST_F(ConfigTest, ReadsSecurity) {
  const SecurityOptions security = Read(R"(
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

TEST_F(ConfigTest, AFaultNamesItsLineAndKey) {
  const std::string pair = "[tls]\ncertificate = \"/c\"\nkey = \"/k\"\n";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"[haptics]\n\nstiffness = 1\n", "3 haptics.stiffness"},
      {"[haptics]\nmethod = \"mc33\"\n", "2 haptics.method"},
      {"[haptics]\nforce_shading = 1\n", "2 haptics.force_shading"},
      {"[haptics]\npop_force_n = true\n", "2 haptics.pop_force_n"},
      {"[haptics]\nfree_side = \"left\"\n", "2 haptics.free_side"},
      {"[realtime]\npriority = 200\n", "2 realtime.priority"},
      {"[volume]\nspacing_mm = [1, 2]\n", "2 volume.spacing_mm"},
      {"[device]\nframes = \"usb\"\n", "2 device.frames"},
      {"[device]\nstate_command = 256\n", "2 device.state_command"},
      {"[device]\npressed_buttons = 4\n", "2 device.pressed_buttons"},
      {"[state]\nfolder = 3\n", "2 state.folder"},
      {"[server]\nlisten = \"7400\"\n", "2 server.listen"},
      {"[server\n", "1 "},
      // Security that cannot work.
      {"[server]\nsocket_role = \"root\"\n", "2 server.socket_role"},
      {"[tls]\nkey = \"k.pem\"\n", "2 tls.key"},
      {"[tls]\nclient = 3\n", "2 tls.client"},
      {pair + "[[tls.client]]\nname = \"a\"\n", "4 tls.client"},
      {pair + "[[tls.client]]\nsan = \"a\"\n", "4 tls.client"},
      {"[limits]\npose_streams = 0\n", "2 limits.pose_streams"},
      {"[limits]\npose_samples_per_s = 1999\n", "2 limits.pose_samples_per_s"},
      // Of keys that come together, the one that is there.
      {"[tls]\nkey = \"/k\"\n", "2 tls.key"},
      {"[tls]\ncertificate = \"/c\"\n", "2 tls.certificate"},
      {"[tls]\n\ntokens = \"/t\"\n", "3 tls.tokens"},
      {pair + "client_ca = \"/ca\"\n", "4 tls.client_ca"},
      {pair + "[[tls.client]]\nsan = \"a\"\nrole = \"viewer\"\n", "4 tls.client"},
      // Unknown tables.
      {"\n[tsl]\ncertificate = \"/c\"\n", "2 tsl"},
      {"[log]\n[haptics.surface]\n", "2 haptics.surface"},
      {"[log]\n[volume.source]\nname = 1\n", "2 volume.source"},
      {"[[haptics]]\nmethod = \"bcc\"\n", "1 haptics"},
      {"log = \"info\"\n", "1 log"},
  };
  for (const auto& [text, fault] : cases) EXPECT_EQ(FirstFault(text), fault) << text;
}

TEST_F(ConfigTest, ValuesOfOtherKindsAreRefused) {
  const std::vector<std::string> no_folders = {"\"/tmp\"",
                                               "1",
                                               "[1]",
                                               "[\"/tmp\", true]",
                                               "[\"tmp\"]",
                                               "[\"\"]",
                                               "[\"/tmp\", \"/no/such/folder\"]",
                                               "[\"/etc/passwd\"]"};
  const std::vector<std::string> no_sizes = {"0",    "-1",         "1.5", "\"1\"",
                                             "true", "1073741825", "[1]"};
  const std::vector<std::pair<std::string, std::vector<std::string>>> cases = {
      {"volume.load_folders", no_folders},
      {"volume.save_folders", no_folders},
      {"volume.upload_folder", {"\"\"", "\"tmp\"", "\"/no/such\"", "1", "[\"/tmp\"]"}},
      {"volume.max_upload_mib", no_sizes},
      {"volume.memory_budget_mib", no_sizes},
      {"device.init_payload", {"[256]", "[1, -1]", "[1.0]", "3"}}};
  for (const auto& [key, values] : cases) {
    const auto dot = key.find('.');
    for (const std::string& bad : values) {
      const std::string text = "[" + key.substr(0, dot) + "]\n" + key.substr(dot + 1) + " = " + bad;
      EXPECT_EQ(FirstFault(text + "\n"), "2 " + key) << bad;
    }
  }
  EXPECT_GT(Read("").memory_budget_bytes, 0u);
}

}  // namespace
}  // namespace palpate
