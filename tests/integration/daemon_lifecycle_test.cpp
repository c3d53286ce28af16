// Starting and ending palpated, and what it says when it cannot.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <fstream>

#include "tests/support/daemon.h"
#include "tests/support/free_port.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

const std::vector<std::string> kSmall = {"--volume", "builtin:sphere:16"};

std::vector<std::string> Small(std::vector<std::string> more) {
  more.insert(more.begin(), kSmall.begin(), kSmall.end());
  return more;
}

// Not the state of whoever runs the tests.
ProcessResult RunDaemon(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {test::kPalpated, "--state-folder", ""});
  return Process(arguments).Wait();
}

// Its last line is the daemon's one-line complaint.
std::string Complaint(const ProcessResult& result) {
  const std::size_t at = result.error.find("palpated: ");
  const std::string line = at == std::string::npos ? "" : result.error.substr(at);
  EXPECT_EQ(std::count(line.begin(), line.end(), '\n'), 1) << result.error;
  return line;
}

TEST(Lifecycle, EndsInOrderOnATerminationSignal) {
  for (int signal : {SIGTERM, SIGINT, SIGQUIT}) {
    Daemon daemon(test::kPalpated, kSmall);
    PoseCollector collector(daemon);
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    const ProcessResult result = daemon.End(signal);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    EXPECT_NE(result.error.find("ended after"), std::string::npos) << result.error;
    EXPECT_FALSE(std::filesystem::exists(daemon.socket()));
  }
}

TEST(Lifecycle, StartsOverTheSocketOfOneThatWasKilled) {
  TemporaryFolder folder;
  const std::string socket = folder.path() / "s.sock";
  const std::vector<std::string> command = {
      test::kPalpated, "--volume", "builtin:sphere:16", "--socket", socket, "--state-folder", ""};
  {
    Process first(command);
    ASSERT_TRUE(first.WaitFor("ready on"));
    first.Signal(SIGKILL);
    EXPECT_EQ(first.Wait().exit_code, -SIGKILL);
  }
  ASSERT_TRUE(std::filesystem::exists(socket));
  Process second(command);
  EXPECT_TRUE(second.WaitFor("ready on"));
  second.Signal(SIGTERM);
  EXPECT_EQ(second.Wait().exit_code, 0);
}

TEST(Lifecycle, ASecondDaemonOnTheSocketIsRefused) {
  Daemon daemon(test::kPalpated, kSmall);
  const ProcessResult second = RunDaemon(Small({"--socket", daemon.socket()}));
  EXPECT_EQ(second.exit_code, 7);
  EXPECT_NE(Complaint(second).find("another palpated listens on"), std::string::npos);
  // The first one is none the worse.
  grpc::ClientContext context;
  v1::GetDeviceResponse response;
  EXPECT_TRUE(daemon.device->GetDevice(&context, {}, &response).ok());
}

TEST(Lifecycle, APortInUseIsNamed) {
  const int taken = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<in_port_t>(FreePort()));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(bind(taken, reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
  ASSERT_EQ(listen(taken, 1), 0);
  const std::string listen_on = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));

  TemporaryFolder folder;
  const std::string socket = folder.path() / "s.sock";
  const ProcessResult result = RunDaemon(Small({"--socket", socket, "--listen", listen_on}));
  EXPECT_EQ(result.exit_code, 7);
  EXPECT_NE(Complaint(result).find(listen_on + ": Address already in use"), std::string::npos)
      << result.error;
  close(taken);
  // Free now: the same command works, over TCP too.
  Daemon daemon(test::kPalpated, Small({"--listen", listen_on}));
  const ProcessResult info = Process({test::kPalpate, "info", "--server", listen_on}).Wait();
  EXPECT_EQ(info.exit_code, 0) << info.error;
}

TEST(Lifecycle, ListensOnLoopbackOnly) {
  // A name may resolve to anything, whatever it starts with.
  for (const char* address : {"0.0.0.0:7400", "127.example:7400", "[::]:7400", "10.0.0.1:7400"}) {
    const ProcessResult result = RunDaemon(Small({"--listen", address}));
    EXPECT_EQ(result.exit_code, 3) << address;
    EXPECT_NE(Complaint(result).find("only loopback"), std::string::npos) << result.error;
  }
}

TEST(Lifecycle, WithoutRealTimeRightsItSaysSoAndGoesOn) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root, to give the rights up";
  // Without capabilities and with the limits of an ordinary user.
  Daemon daemon(test::kPalpated, kSmall,
                {"/usr/bin/setpriv", "--bounding-set=-all", "--inh-caps=-all", "/usr/bin/prlimit",
                 "--rtprio=0", "--memlock=65536"});
  EXPECT_TRUE(daemon.WaitForTicks(300));
  grpc::ClientContext context;
  v1::GetDeviceResponse response;
  ASSERT_TRUE(daemon.device->GetDevice(&context, {}, &response).ok());
  EXPECT_FALSE(response.servo().realtime_scheduling());
  EXPECT_FALSE(response.servo().memory_locked());
  EXPECT_GE(response.servo().warnings_size(), 2);
  const ProcessResult result = daemon.End();
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_NE(result.error.find("no real-time scheduling"), std::string::npos) << result.error;
}

TEST(Lifecycle, BadStartsGiveOneLineAndACode) {
  TemporaryFolder folder;
  const std::string socket = folder.path() / "s.sock";
  const std::string config = folder.path() / "bad.toml";
  std::ofstream(config) << "[haptics]\nstiffness_n_per_mm = \"soft\"\n";
  const std::string guessed = folder.path() / "guessed.toml";
  std::ofstream(guessed) << "[device]\nkind = \"omni-usb\"\nframes = \"framed-firewire\"\n";
  const std::string buttons = folder.path() / "buttons.toml";
  std::ofstream(buttons) << "[device]\nstop_buttons = 12\n";
  struct Case {
    std::vector<std::string> arguments;
    int exit_code;
    std::string text;
  };
  for (const Case& c : std::vector<Case>{
           {{"--volume", folder.path() / "absent.nrrd"}, 4, "absent.nrrd"},
           {{"--volume", "builtin:cube"}, 3, "no such builtin volume"},
           {{"--volume", "builtin:sphere:16", "--isovalue", "5"}, 3, "isovalue 5 is not within"},
           {{"--volume", "builtin:sphere:16", "--normalized-isovalue", "-1"}, 3, "not within"},
           {{"--stiffness-n-per-mm", "50"}, 3, "stiffness_n_per_mm 50"},
           {{"--device", "phantom"}, 3, "unknown device phantom: give simulated, replay, omni-usb"},
           {{"--device", "replay"}, 3, "set [device] replay_file"},
           {{"--device", "openhaptics"}, 4, "install the vendor's OpenHaptics"},
           {{"--config", guessed}, 3, "needs `state_command` and `force_command`"},
           {{"--config", buttons}, 3, "stop_buttons names a button that simulated does not have"},
           {{"--method", "mc33"}, 3, "unknown method mc33"},
           {{"--listen", "somewhere"}, 3, "somewhere"},
           {{"--config", config}, 3, "bad.toml:2: haptics.stiffness_n_per_mm must be a number"}}) {
    std::vector<std::string> arguments = c.arguments;
    arguments.insert(arguments.end(), {"--socket", socket});
    const ProcessResult result = RunDaemon(arguments);
    EXPECT_EQ(result.exit_code, c.exit_code) << result.error;
    EXPECT_NE(Complaint(result).find(c.text), std::string::npos) << result.error;
  }
  const std::string file = folder.path() / "my.data";
  std::ofstream(file) << "precious";
  const ProcessResult not_a_socket = RunDaemon({"--socket", file});
  EXPECT_EQ(not_a_socket.exit_code, 3);
  EXPECT_NE(Complaint(not_a_socket).find("is no socket"), std::string::npos);
  EXPECT_EQ(std::filesystem::file_size(file), 8u);
  EXPECT_EQ(RunDaemon({"--no-such-flag"}).exit_code, 2);
  EXPECT_EQ(RunDaemon({"--help"}).exit_code, 0);
  EXPECT_EQ(RunDaemon({"--socket", "/proc/none/s.sock"}).exit_code, 5);
}

TEST(Lifecycle, ReadsItsConfiguration) {
  TemporaryFolder folder;
  const std::string config = folder.path() / "palpated.toml";
  std::ofstream(config) << "[volume]\nsource = \"builtin:gyroid:16\"\nnormalized_isovalue = 0.25\n"
                           "[haptics]\nstiffness_n_per_mm = 0.7\ndynamic_friction = 0.3\n"
                           "force_shading = true\nfree_side = \"above\"\n";
  Daemon daemon(test::kPalpated, {"--config", config, "--damping-n-s-per-m", "2"});
  grpc::ClientContext context;
  v1::GetSettingsResponse response;
  ASSERT_TRUE(daemon.render->GetSettings(&context, {}, &response).ok());
  EXPECT_NEAR(response.settings().normalized_isovalue(), 0.25, 1e-9);
  EXPECT_EQ(response.settings().stiffness_n_per_mm(), 0.7);
  EXPECT_EQ(response.settings().damping_n_s_per_m(), 2.0);
  EXPECT_EQ(response.settings().dynamic_friction(), 0.3);
  EXPECT_TRUE(response.settings().force_shading());
  EXPECT_FALSE(response.settings().passivity_control());
  EXPECT_EQ(response.settings().free_side(), v1::FREE_SIDE_ABOVE);
}

}  // namespace
}  // namespace palpate::test
