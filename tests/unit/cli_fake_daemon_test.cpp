// The program `palpate` itself against a palpated with canned answers: output, exit codes,
// signals. cli_watch_test.cpp has `palpate watch`.
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/certificates.h"
#include "tests/support/process.h"
#include "tests/unit/cli_fixture.h"

namespace palpate::test {
namespace {

TEST_F(CliTest, HelpNeedsNoDaemon) {
  for (const std::vector<std::string>& command :
       std::vector<std::vector<std::string>>{{},
                                             {"info"},
                                             {"watch"},
                                             {"set"},
                                             {"set", "stiffness"},
                                             {"settings"},
                                             {"load"},
                                             {"upload"},
                                             {"series"},
                                             {"series", "load"},
                                             {"series", "play"},
                                             {"series", "seek"},
                                             {"series", "loop"},
                                             {"series", "info"}}) {
    std::vector<std::string> arguments = command;
    arguments.push_back("--help");
    const ProcessResult result = Run(arguments);
    EXPECT_EQ(result.exit_code, 0);
    EXPECT_NE(result.output.find("Example"), std::string::npos) << result.output;
  }
  EXPECT_EQ(Run({"--version"}).output.rfind("palpate ", 0), 0u);
}

TEST_F(CliTest, WrongUsageIsOneLineAndExitCode2) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {},
           {"touch"},
           {"set"},
           {"set", "isovalue"},
           {"set", "isovalue", "forty"},
           {"set", "isovalue", "nan"},
           {"set", "isovalue", "-inf"},
           {"set", "isovalue", "1", "2"},
           {"set", "method", "cubes"},
           {"set", "friction", "1"},
           {"set", "stiffness", "much"},
           {"set", "stiffness", "1", "--normalized"},
           {"set", "force_shading", "2"},
           {"set", "free_side", "left"},
           {"watch", "--rate-hz", "0"},
           {"watch", "--rate-hz", "1001"},
           {"watch", "--count", "0"},
           {"watch", "--count", "-1"},
           {"watch", "--seconds", "-1"},
           {"load"},
           {"load", "a", "--spacing-mm", "1,2"},
           {"load", "a", "--spacing-mm", "1,2,-3"},
           {"load", "a", "--isovalue", "1", "--normalized-isovalue", "1"},
           {"load", "a", "--raw-size", "4,4,4"},
           {"load", "a", "--raw-type", "uint8"},
           {"load", "a", "--raw-size", "4,4", "--raw-type", "uint8"},
           {"load", "a", "--raw-size", "4,4,0", "--raw-type", "uint8"},
           {"load", "a", "--raw-size", "4,4,-4", "--raw-type", "uint8"},
           {"load", "a", "--raw-size", "4,4,4.5", "--raw-type", "uint8"},
           {"load", "a", "--raw-size", "4,4,4294967296", "--raw-type", "uint8"},
           {"load", "a", "--raw-size", "4,4,4", "--raw-type", "uint9"},
           {"load", "a", "--raw-big-endian"},
           {"load", "a", "--raw-offset-bytes", "4"},
           {"load", "a", "--raw-size", "4,4,4", "--raw-type", "int8", "--raw-offset-bytes", "-1"},
           {"load", "a", "--frame", "-1"},
           {"load", "a", "--frame", "first"},
           {"info", "--socket", "a", "--server", "b:1"},
           {"info", "extra"}}) {
    ExpectOneError(Run(arguments), 2, "--help");
  }
}

TEST_F(CliTest, WrongValuesAreToldWithTheRightOnes) {
  ExpectOneError(Run({"set", "stiffness_n_per_mm", "much"}), 2,
                 "stiffness cannot be 'much': give 0 to 3 N/mm");
  ExpectOneError(Run({"set", "free_side", "left"}), 2, "give below or above");
  ExpectOneError(Run({"set", "friction", "1"}), 2, "there is no setting 'friction'");
}

TEST_F(CliTest, HelpOfSetNamesEverySettingWithItsUnit) {
  const std::string help = Run({"set", "--help"}).output;
  for (const char* part : {"isovalue ",        "--normalized",
                           "stiffness ",       "0 to 3 N/mm",
                           "damping ",         "0 to 5 N·s/m",
                           "static_friction ", "dynamic_friction ",
                           "viscosity ",       "pop_force ",
                           "0 to 3.3 N",       "magnet_force ",
                           "0 to 1.5 N",       "magnet_range ",
                           "0 to 10 mm",       "force_shading ",
                           "on or off",        "passivity_control ",
                           "free_side ",       "below or above",
                           "method ",          "tpbcc"}) {
    EXPECT_NE(help.find(part), std::string::npos) << part << "\n" << help;
  }
}

TEST_F(CliTest, InfoNamesEverything) {
  StartDaemon();
  const ProcessResult result = Run({"info"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  for (const char* part :
       {"palpated 9.8.7 at unix:", "Simulated stylus", "verification level: simulated", "1000 Hz",
        "990 ticks, 10 missed (1.000 %)", "warning: no SCHED_FIFO", "64 x 65 x 66 voxels",
        "0.5 x 0.5 x 1.25 mm", "values 0 to 255", "isovalue 40.8 (normalised 0.16)", "method tpbcc",
        "scale 1.5 mm"}) {
    EXPECT_NE(result.output.find(part), std::string::npos) << part << "\n" << result.output;
  }
}

TEST_F(CliTest, InfoJson) {
  StartDaemon();
  const Json json = Json::parse(Run({"info", "--json"}).output);
  EXPECT_EQ(json["version"], "9.8.7");
  EXPECT_EQ(json["device"]["verification_level"], "simulated");
  EXPECT_EQ(json["servo"]["missed_ticks"], 10);
  EXPECT_EQ(json["servo"]["warnings"][0], "no SCHED_FIFO: raise rtprio");
  EXPECT_EQ(json["volume"]["size"], Json({64, 65, 66}));
  EXPECT_EQ(json["volume"]["spacing_mm"], Json({0.5, 0.5, 1.25}));
  EXPECT_EQ(json["settings"]["settings_revision"], 6);
}

TEST_F(CliTest, SettingsInTextAndJson) {
  StartDaemon();
  const std::string text = Run({"settings"}).output;
  EXPECT_NE(text.find("stiffness 0.5 N/mm"), std::string::npos);
  EXPECT_NE(text.find("off: damping\n"), std::string::npos) << text;
  const Json json = Json::parse(Run({"settings", "--json"}).output);
  EXPECT_EQ(json["isovalue"], 40.8);
  EXPECT_EQ(json["method"], "tpbcc");
}

TEST_F(CliTest, SetTellsTheTick) {
  StartDaemon();
  EXPECT_EQ(Run({"set", "isovalue", "41.5"}).output,
            "isovalue 41.5 applied at tick 123456, settings revision 7, 1.2 ms after receipt\n");
  EXPECT_EQ(daemon_->render.last_update.update_mask().paths(0), "isovalue");
  EXPECT_FALSE(daemon_->render.last_update.has_expected_revision());
}

TEST_F(CliTest, SetTakesNegativeIsovalues) {
  StartDaemon();
  for (const auto& [text, value] : std::vector<std::pair<std::string, double>>{
           {"-200", -200.0}, {"-1e3", -1000.0}, {"-.5", -0.5}, {"-0.25", -0.25}}) {
    EXPECT_EQ(Run({"set", "isovalue", text}).exit_code, 0) << text;
    EXPECT_EQ(daemon_->render.last_update.settings().isovalue(), value);
  }
  EXPECT_EQ(Run({"set", "isovalue", "--json", "-7", "--socket", socket_}).exit_code, 0);
  EXPECT_EQ(daemon_->render.last_update.settings().isovalue(), -7.0);
}

TEST_F(CliTest, SetSendsOnlyTheFieldItNames) {
  StartDaemon();
  const auto sent = [this](const std::vector<std::string>& arguments) {
    EXPECT_EQ(Run(arguments).exit_code, 0);
    EXPECT_EQ(daemon_->render.last_update.update_mask().paths_size(), 1);
    return daemon_->render.last_update.update_mask().paths(0) + " " +
           daemon_->render.last_update.settings().ShortDebugString();
  };
  EXPECT_EQ(sent({"set", "isovalue", "--normalized", "0.5"}),
            "normalized_isovalue normalized_isovalue: 0.5");
  EXPECT_EQ(sent({"set", "isovalue", "0.5", "--normalized"}),
            "normalized_isovalue normalized_isovalue: 0.5");
  EXPECT_EQ(sent({"set", "stiffness", "0.75"}), "stiffness_n_per_mm stiffness_n_per_mm: 0.75");
  EXPECT_EQ(sent({"set", "damping", "0"}), "damping_n_s_per_m damping_n_s_per_m: 0");
  EXPECT_EQ(sent({"set", "damping_n_s_per_m", "-.5"}), "damping_n_s_per_m damping_n_s_per_m: -0.5");
  EXPECT_EQ(sent({"set", "normalized_isovalue", "0.5"}),
            "normalized_isovalue normalized_isovalue: 0.5");
  EXPECT_EQ(sent({"set", "--json", "force_shading", "off"}), "force_shading force_shading: false");
  EXPECT_EQ(sent({"set", "free_side", "above"}), "free_side free_side: FREE_SIDE_ABOVE");
  EXPECT_EQ(sent({"set", "method", "bcc"}), "method method: DECOMPOSITION_METHOD_BCC");
}

TEST_F(CliTest, SetJson) {
  StartDaemon();
  const Json json = Json::parse(Run({"set", "stiffness", "0.75", "--json"}).output);
  EXPECT_EQ(json["stiffness_n_per_mm"], 0.75);
  EXPECT_EQ(json["applied_tick"], 123456);
  EXPECT_EQ(json["settings_revision"], 7);
  EXPECT_EQ(json["receipt_to_applied_ns"], 1200000);
}

TEST_F(CliTest, RevisionConflictIsExitCode7) {
  StartDaemon();
  ExpectOneError(Run({"set", "isovalue", "40", "--expected-revision", "5"}), 7, "at revision 6");
  EXPECT_EQ(Run({"set", "--expected-revision", "6", "isovalue", "40"}).exit_code, 0);
}

TEST_F(CliTest, RefusedValueIsExitCode3OnOneLine) {
  StartDaemon();
  ExpectOneError(Run({"set", "stiffness", "99"}), 3, "0 to 3 N/mm, not more");
}

TEST_F(CliTest, SocketAndServerMayFollowTheCommand) {
  StartDaemon();
  unsetenv("PALPATE_SOCKET");
  const std::string server = "127.0.0.1:" + std::to_string(daemon_->port);
  EXPECT_EQ(Run({"--socket", socket_, "settings"}).exit_code, 0);
  EXPECT_EQ(Run({"set", "isovalue", "1", "--socket", socket_}).exit_code, 0);
  EXPECT_EQ(Run({"settings", "--server", server}).exit_code, 0);
  EXPECT_EQ(Run({"watch", "--count", "3", "--json", "--server", server}).exit_code, 0);
}

TEST_F(CliTest, NoDaemonSaysHowToStartIt) {
  ExpectOneError(Run({"info"}), 8,
                 "no palpated at unix:" + socket_ +
                     ": start it with 'palpated', or name another one with --socket");
  ExpectOneError(Run({"watch", "--server", "127.0.0.1:1"}), 8, "no palpated at 127.0.0.1:1");
  ExpectOneError(Run({"info", "--server", "nonsense"}), 3, "names no port");
  ExpectOneError(Run({"info", "--socket", folder_ + "/" + std::string(200, 'x')}), 3,
                 "at most 107");
}

// Binds a socket. Without `accepts`, no server listens on it.
void BindSocket(const std::string& path, int& file, bool accepts) {
  file = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof(address.sun_path) - 1);
  ASSERT_EQ(bind(file, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  if (accepts) {
    ASSERT_EQ(listen(file, 5), 0);
  }
}

TEST_F(CliTest, WrongSocketsAreTold) {
  std::ofstream(folder_ + "/file").put('x');
  ExpectOneError(Run({"info", "--socket", folder_ + "/file"}), 8, "is not a socket");
  int stale = -1;
  BindSocket(folder_ + "/stale.sock", stale, false);
  ExpectOneError(Run({"info", "--socket", folder_ + "/stale.sock"}), 8, "no palpated at");
  int silent = -1;
  BindSocket(folder_ + "/silent.sock", silent, true);
  ExpectOneError(Run({"info", "--socket", folder_ + "/silent.sock"}), 8, "within 3 s");
  close(stale);
  close(silent);
}

TEST_F(CliTest, SocketOfSomebodyElseIsNoPermission) {
  if (getuid() == 0) {
    GTEST_SKIP() << "root may use every socket";
  }
  StartDaemon();
  std::filesystem::permissions(socket_, std::filesystem::perms::none);
  ExpectOneError(Run({"info"}), 5, "no permission");
}

// The warning comes once, before anything is sent, for an option and for the environment.
TEST_F(CliTest, ATokenThatOthersMayReadIsOneLineMore) {
  StartDaemon();
  const Certificates files;
  files.MakeAuthority("lab");
  const std::string token = files.In("token");
  std::ofstream(token) << "palpate_x\n";
  chmod(token.c_str(), 0644);
  const std::vector<std::string> command = {"info", "--server",
                                            "127.0.0.1:" + std::to_string(daemon_->port),
                                            "--tls-ca", files.In("lab.pem")};
  std::vector<std::string> with_token = command;
  with_token.insert(with_token.end(), {"--token-file", token});
  setenv("PALPATE_TOKEN_FILE", token.c_str(), 1);
  const ProcessResult by_environment = Run(command);
  unsetenv("PALPATE_TOKEN_FILE");
  for (const ProcessResult& result : {by_environment, Run(with_token)}) {
    // The daemon has no TLS.
    EXPECT_EQ(result.exit_code, 8);
    const std::vector<std::string> lines = Lines(result.error);
    ASSERT_EQ(lines.size(), 2u) << result.error;
    EXPECT_TRUE(lines[0].starts_with("palpate: warning: the token file " + token)) << lines[0];
  }
  chmod(token.c_str(), 0600);
  ExpectOneError(Run(with_token), 8, "TLS");
}

// Returns one check of `palpate doctor --json`.
Json CheckNamed(const Json& doctor, const std::string& name) {
  for (const Json& check : doctor["checks"]) {
    if (check["name"] == name) return check;
  }
  return {};
}

TEST_F(CliTest, TheDoctorLooksAtARunningDaemon) {
  StartDaemon();
  daemon_->device.ticks_per_call = 300;
  Json doctor = Json::parse(Run({"doctor", "--json"}).output);
  for (const char* name : {"daemon", "ticks", "device", "forces"}) {
    EXPECT_EQ(CheckNamed(doctor, name)["verdict"], "ok") << name;
    EXPECT_EQ(CheckNamed(doctor, name)["advice"], "") << name;
  }
  EXPECT_EQ(CheckNamed(doctor, "ticks")["text"], "300 ticks while it was watched, 0 missed");
  EXPECT_EQ(CheckNamed(doctor, "device")["text"], "simulated, streaming");

  daemon_->device.health.set_connection(v1::DEVICE_CONNECTION_ABSENT);
  daemon_->device.health.set_problem("not found:\nplug it in");
  daemon_->device.forces.set_state(v1::FORCE_STATE_HELD);
  daemon_->device.forces.set_reason(v1::FORCE_REASON_DOCKED);
  daemon_->device.ticks_per_call = 0;
  const ProcessResult result = Run({"doctor", "--json"});
  EXPECT_EQ(result.exit_code, 10);
  doctor = Json::parse(result.output);
  EXPECT_EQ(CheckNamed(doctor, "ticks")["verdict"], "fail");
  EXPECT_EQ(CheckNamed(doctor, "ticks")["text"], "the haptic loop does not tick: it stays at 990");
  EXPECT_EQ(CheckNamed(doctor, "device")["verdict"], "fail");
  EXPECT_EQ(CheckNamed(doctor, "device")["text"], "simulated, absent: not found: plug it in");
  EXPECT_EQ(CheckNamed(doctor, "forces")["verdict"], "warn");
  EXPECT_EQ(CheckNamed(doctor, "forces")["advice"], "the stylus rests in its holder: take it out");
  for (const char* name : {"ticks", "device"}) {
    EXPECT_NE(CheckNamed(doctor, name)["advice"], "") << name;
  }
}

TEST_F(CliTest, WithoutADaemonTheDoctorJudgesTheMachineAlone) {
  const Json doctor = Json::parse(Run({"doctor", "--json"}).output);
  EXPECT_EQ(CheckNamed(doctor, "daemon")["verdict"], "warn");
  for (const char* name : {"ticks", "device", "forces"}) {
    EXPECT_TRUE(CheckNamed(doctor, name).is_null()) << name;
  }
}

TEST_F(CliTest, AnotherServiceIsTold) {
  StartDaemon(false);
  ExpectOneError(Run({"settings"}), 8, "is not palpated");
  ExpectOneError(Run({"watch", "--json"}), 8, "is not palpated");
}

TEST_F(CliTest, LoadShowsProgressThenTheVolume) {
  StartDaemon();
  const ProcessResult result = Run({"load", "a.nrrd", "--isovalue", "-200", "--spacing-mm",
                                    "1,2,3.5", "--device-mm-per-volume-mm", "0.25"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(Lines(result.error).size(), 5u) << result.error;  // 0, 25, 50, 75, 100 %
  EXPECT_NE(result.error.find("100 % reading"), std::string::npos) << result.error;
  EXPECT_NE(result.output.find("64 x 65 x 66 voxels"), std::string::npos);
  EXPECT_NE(result.output.find("applied at tick 777, settings revision 8"), std::string::npos);
  const v1::LoadVolumeRequest& request = daemon_->volume.last_load;
  EXPECT_EQ(request.source(), (std::filesystem::current_path() / "a.nrrd").string());
  EXPECT_EQ(request.isovalue(), -200.0);
  EXPECT_EQ(request.spacing_mm().z(), 3.5);
  EXPECT_EQ(request.device_mm_per_volume_mm(), 0.25);
}

TEST_F(CliTest, LoadSendsNothingThatWasNotAsked) {
  StartDaemon();
  EXPECT_EQ(Run({"load", "builtin:sphere:64"}).exit_code, 0);
  EXPECT_EQ(daemon_->volume.last_load.ShortDebugString(), "source: \"builtin:sphere:64\"");
  EXPECT_EQ(Run({"load", "builtin:x", "--normalized-isovalue", "0"}).exit_code, 0);
  EXPECT_TRUE(daemon_->volume.last_load.has_normalized_isovalue());
}

TEST_F(CliTest, LoadSaysWhatRawVoxelsAre) {
  StartDaemon();
  ASSERT_EQ(Run({"load", "/a.raw", "--raw-size", "7,8,9", "--raw-type", "uint16",
                 "--raw-big-endian", "--raw-offset-bytes", "12", "--frame", "3"})
                .exit_code,
            0);
  EXPECT_EQ(daemon_->volume.last_load.ShortDebugString(),
            "source: \"/a.raw\" raw { size_x: 7 size_y: 8 size_z: 9 type: VOXEL_TYPE_UINT16 "
            "big_endian: true offset_bytes: 12 } frame: 3");
  ASSERT_EQ(Run({"load", "/a.raw", "--raw-size", "7,8,9", "--raw-type", "float64", "--frame", "0"})
                .exit_code,
            0);
  EXPECT_EQ(daemon_->volume.last_load.ShortDebugString(),
            "source: \"/a.raw\" raw { size_x: 7 size_y: 8 size_z: 9 type: VOXEL_TYPE_FLOAT64 } "
            "frame: 0");
}

TEST_F(CliTest, LoadOfAnAbsentFileIsExitCode4) {
  StartDaemon();
  ExpectOneError(Run({"load", "/absent.nrrd"}), 4, "no file /absent.nrrd");
}

TEST_F(CliTest, SignalCancelsTheLoad) {
  StartDaemon();
  Process process(Command({"load", "/slow.nrrd"}));
  ASSERT_TRUE(process.WaitFor("100 %"));
  process.Signal(SIGINT);
  const ProcessResult result = process.Wait();
  EXPECT_EQ(result.exit_code, 9);
  EXPECT_EQ(Lines(result.error).back(),
            "palpate: loading was cancelled; the volume before it stays");
  for (int i = 0; i < 100 && !daemon_->volume.load_was_cancelled; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_TRUE(daemon_->volume.load_was_cancelled);
}

TEST_F(CliTest, DaemonGoingAwayEndsTheLoadWithExitCode8) {
  StartDaemon();
  Process process(Command({"load", "/slow.nrrd"}));
  ASSERT_TRUE(process.WaitFor("100 %"));
  daemon_->Die();
  EXPECT_EQ(process.Wait().exit_code, 8);
}

}  // namespace
}  // namespace palpate::test
