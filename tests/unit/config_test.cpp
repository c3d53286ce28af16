// The configuration file.
#include "server/app/config.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <fstream>
#include <functional>

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
    return ReadConfig(file, {}, config).faults;
  }

  test::TemporaryFolder folder_;
};

// Of what is felt, which is read by the contract's list, one number and one flag.
TEST_F(ConfigTest, ReadsEveryKey) {
  const std::vector<std::filesystem::path> folders = {"/tmp", "/"};
  struct Key {
    std::string text;
    std::function<bool(const Config&)> is_read;
  };
  const Key keys[] = {
      {"volume.source = '/data/a.nrrd'", [](auto& c) { return c.volume.source == "/data/a.nrrd"; }},
      {"volume.isovalue = 300", [](auto& c) { return c.volume.isovalue == 300.0; }},
      {"volume.spacing_mm = [1, 1.0, 2.5]",
       [](auto& c) { return c.volume.spacing_mm == Vec3(1, 1, 2.5); }},
      {"volume.device_mm_per_volume_mm = 0.5",
       [](auto& c) { return c.volume.device_mm_per_volume_mm == 0.5; }},
      {"volume.frame = 3", [](auto& c) { return c.volume.frame == 3; }},
      {"haptics.layer = [{name = 'skin', isovalue = -300, pop_force_n = 1}, {name = 'bone', "
       "isovalue = 300, id = 1}]",
       [](auto& c) {
         const auto& layers = c.haptics.layers.layer;
         return layers.size() == 2 && layers[0].id == 0 && layers[0].pop_force_n == 1.0 &&
                layers[0].stiffness_n_per_mm == 0.5 && layers[1].name == "bone";
       }},
      {"volume.raw_size = [4, 5, 6]",
       [](auto& c) {
         return c.volume.raw->size == std::array<std::int64_t, 3>{4, 5, 6};
       }},
      {"volume.raw_type = 'int16'", [](auto& c) { return c.volume.raw->type == "int16"; }},
      {"volume.raw_big_endian = true", [](auto& c) { return c.volume.raw->big_endian; }},
      {"volume.raw_offset_bytes = 12", [](auto& c) { return c.volume.raw->offset_bytes == 12; }},
      {"volume.load_folders = ['/tmp', '/']", [&](auto& c) { return c.load_folders == folders; }},
      {"volume.save_folders = []",
       [](auto& c) { return c.save_folders && c.save_folders->empty(); }},
      {"volume.memory_budget_mib = 300",
       [](auto& c) { return c.memory_budget_bytes == std::uint64_t{300} << 20; }},
      {"volume.max_upload_mib = 200",
       [](auto& c) { return c.uploads.max_bytes == std::uint64_t{200} << 20; }},
      {"volume.upload_vdb = false", [](auto& c) { return !c.uploads.vdb; }},
      {"volume.upload_folder = '/tmp'", [](auto& c) { return c.uploads.folder == "/tmp"; }},
      {"metrics.listen = '127.0.0.1:9464'", [](auto& c) { return c.metrics_listen->port == 9464; }},
      {"haptics.stiffness_n_per_mm = 0.75",
       [](auto& c) { return c.haptics.stiffness_n_per_mm == 0.75; }},
      {"haptics.force_shading = true", [](auto& c) { return c.haptics.force_shading; }},
      {"haptics.free_side = 'above'",
       [](auto& c) { return c.haptics.free_side == FreeSide::kAbove; }},
      {"haptics.method = 'bcc'",
       [](auto& c) { return c.haptics.method == DecompositionMethod::kBcc; }},
      {"server.socket = '/tmp/s.sock'", [](auto& c) { return c.socket_path == "/tmp/s.sock"; }},
      {"server.listen = '127.0.0.1:7400'", [](auto& c) { return c.listen->port == 7400; }},
      {"server.socket_role = 'editor'",
       [](auto& c) { return c.security.policy.socket_role == Role::kEditor; }},
      {"server.loopback_role = 'viewer'",
       [](auto& c) { return c.security.policy.loopback_role == Role::kViewer; }},
      {"server.operator_group = 'a'", [](auto& c) { return c.groups.operators == "a"; }},
      {"server.editor_group = 'b'", [](auto& c) { return c.groups.editors == "b"; }},
      {"server.viewer_group = 'c'", [](auto& c) { return c.groups.viewers == "c"; }},
      {"server.door_group = 'd'", [](auto& c) { return c.groups.door == "d"; }},
      {"realtime.priority = 70", [](auto& c) { return c.realtime.priority == 70; }},
      {"realtime.cpu = 1", [](auto& c) { return c.realtime.cpu == 1; }},
      {"realtime.lock_memory = false", [](auto& c) { return !c.realtime.lock_memory; }},
      {"state.folder = '/var/a'", [](auto& c) { return c.state_folder == "/var/a"; }},
      {"state.fresh = true", [](auto& c) { return c.fresh; }},
      {"log.level = 'warning'", [](auto& c) { return c.log_level == "warning"; }},
      {"device.kind = 'simulated'", [](auto& c) { return c.device.kind == "simulated"; }},
      {"device.pressed_buttons = 3", [](auto& c) { return c.device.pressed_buttons == 3; }},
      {"device.stop_buttons = 2", [](auto& c) { return c.device.stop_buttons == 2u; }},
      {"device.replay_file = '/a.mcap'", [](auto& c) { return c.device.replay_file == "/a.mcap"; }},
      {"device.usb_port = '1-2'", [](auto& c) { return c.device.usb_port == "1-2"; }},
      {"device.torque_n_mm = 50", [](auto& c) { return c.device.torque_n_mm == 50.0; }},
      {"device.serial = '70427300007'", [](auto& c) { return c.device.serial == "70427300007"; }},
      {"device.motor_counts_per_n_mm = [1, -2.5, 3]",
       [](auto& c) {
         return c.device.motor_counts_per_n_mm == std::array<double, 3>{1.0, -2.5, 3.0};
       }},
      {"device.falcon_firmware = '/f.bin'",
       [](auto& c) { return c.device.falcon_firmware == "/f.bin"; }},
      {"device.openhaptics_library = '/h.so'",
       [](auto& c) { return c.device.openhaptics_library == "/h.so"; }},
      {"device.openhaptics_name = 'Left'",
       [](auto& c) { return c.device.openhaptics_name == "Left"; }},
      {"tls.certificate = '/c.pem'",
       [](auto& c) { return c.security.tls.certificate == "/c.pem"; }},
      {"tls.key = '/k.pem'", [](auto& c) { return c.security.tls.key == "/k.pem"; }},
      {"tls.client_ca = '/ca.pem'",
       [](auto& c) { return c.security.policy.client_ca == "/ca.pem"; }},
      {"tls.tokens = '/t.toml'", [](auto& c) { return c.security.policy.tokens == "/t.toml"; }},
      {"tls.client = [{san = 'a', role = 'operator'}, {san = 'spiffe://b', role = 'admin'}]",
       [](auto& c) {
         const auto& clients = c.security.policy.clients;
         return clients.size() == 2 && clients[1].san == "spiffe://b" &&
                clients[1].role == Role::kAdmin;
       }},
      {"limits.connections = 1", [](auto& c) { return c.security.connections == 1; }},
      {"limits.calls_per_s = 2", [](auto& c) { return c.security.limits.calls_per_s == 2; }},
      {"limits.pose_streams = 3", [](auto& c) { return c.security.limits.pose_streams == 3; }},
      {"limits.pose_samples_per_s = 2000",
       [](auto& c) { return c.security.limits.pose_samples_per_s == 2000; }},
      {"limits.volume_streams = 4", [](auto& c) { return c.security.limits.volume_streams == 4; }},
      {"limits.transfers = 5", [](auto& c) { return c.security.limits.transfers == 5; }},
  };
  std::string text;
  for (const Key& key : keys) text += key.text + "\n";
  const Config config = Read(text);
  for (const Key& key : keys) EXPECT_TRUE(key.is_read(config)) << key.text;
}

// The file that users start from. That it has every key of [haptics] with its default:
// settings_list_test.
TEST_F(ConfigTest, TheShippedFileIsRead) { Read(test::TextOf(test::kExampleConfig)); }

TEST_F(ConfigTest, AFaultNamesItsLineAndKey) {
  const std::string pair = "[tls]\ncertificate = \"/c\"\nkey = \"/k\"\n";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"[haptics]\n\nstiffness = 1\n", "3 haptics.stiffness"},
      {"[haptics]\nmethod = \"mc33\"\n", "2 haptics.method"},
      {"[haptics]\nforce_shading = 1\n", "2 haptics.force_shading"},
      {"[haptics]\npop_force_n = true\n", "2 haptics.pop_force_n"},
      {"[haptics]\nfree_side = \"left\"\n", "2 haptics.free_side"},
      {"[[haptics.layer]]\nname = 'skin'\n", "1 haptics.layer"},
      {"[[haptics.layer]]\nname = 'skin'\nisovalue = 1\npop_force_n = 9\n", "1 haptics.layer"},
      {"[realtime]\npriority = 200\n", "2 realtime.priority"},
      {"[volume]\nspacing_mm = [1, 2]\n", "2 volume.spacing_mm"},
      {"[volume]\nraw_size = [1.5, 2, 2]\n", "2 volume.raw_size"},
      {"[volume]\nraw_type = \"char\"\n", "2 volume.raw_type"},
      {"[device]\nframes = \"framed-firewire\"\n", "2 device.frames"},
      {"[device]\nstate_command = 33\n", "2 device.state_command"},
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
  const std::vector<std::string> no_folders = {"\"/tmp\"", "1", "[1]", "[\"/tmp\", true]"};
  const std::vector<std::string> no_sizes = {"0",    "-1",         "1.5", "\"1\"",
                                             "true", "1073741825", "[1]"};
  const std::vector<std::pair<std::string, std::vector<std::string>>> cases = {
      {"volume.load_folders", no_folders},
      {"volume.save_folders", no_folders},
      {"volume.upload_folder", {"1", "[\"/tmp\"]"}},
      {"volume.max_upload_mib", no_sizes},
      {"volume.memory_budget_mib", no_sizes}};
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
