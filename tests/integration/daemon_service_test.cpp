// palpated as a service: what it tells systemd, and SIGHUP.
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "tests/support/daemon.h"
#include "tests/support/free_port.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr seconds kPatience{20};

// systemd's end of the notification socket.
class Manager {
 public:
  explicit Manager(std::chrono::microseconds watchdog) {
    socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string path = folder_.path() / "notify";
    path.copy(address.sun_path, sizeof(address.sun_path) - 1);
    if (bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) != 0) abort();
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
    setenv("WATCHDOG_USEC", std::to_string(watchdog.count()).c_str(), 1);
  }
  ~Manager() {
    unsetenv("NOTIFY_SOCKET");
    unsetenv("WATCHDOG_USEC");
    close(socket_);
  }

  // Empty: nothing came in time.
  std::string Next(milliseconds timeout) const {
    pollfd file{socket_, POLLIN, 0};
    if (poll(&file, 1, static_cast<int>(timeout.count())) <= 0) return "";
    char text[4096];
    const ssize_t count = recv(socket_, text, sizeof(text), 0);
    return std::string(text, static_cast<std::size_t>(count));
  }
  // Whether a message that begins so comes.
  bool Hears(const std::string& text, milliseconds patience = kPatience) const {
    const auto end = Clock::now() + patience;
    while (Clock::now() < end) {
      if (Next(milliseconds(100)).starts_with(text)) return true;
    }
    return false;
  }
  void Forget() const {
    while (!Next(milliseconds(0)).empty()) {
    }
  }

 private:
  TemporaryFolder folder_;
  int socket_ = -1;
};

// Without a terminal, as a service.
const std::vector<std::string> kService = {"/usr/bin/setsid"};

// The servo's thread. 0: there is none.
pid_t ServoThread(pid_t process) {
  for (const auto& task :
       std::filesystem::directory_iterator("/proc/" + std::to_string(process) + "/task")) {
    std::string name;
    std::getline(std::ifstream(task.path() / "comm") >> std::ws, name);
    if (name == "palpate-rt") return static_cast<pid_t>(std::stoi(task.path().filename()));
  }
  return 0;
}

class ConfigFile {
 public:
  void Write(const std::string& text) const {
    std::ofstream(path()) << "[volume]\nsource = \"builtin:sphere:16\"\n" << text;
  }
  std::string path() const { return folder_.path() / "palpated.toml"; }

 private:
  TemporaryFolder folder_;
};

v1::GetSettingsResponse Settings(Daemon& daemon) {
  grpc::ClientContext context;
  v1::GetSettingsResponse response;
  EXPECT_TRUE(daemon.render->GetSettings(&context, {}, &response).ok());
  return response;
}

std::uint64_t Ticks(Daemon& daemon) {
  grpc::ClientContext context;
  v1::GetDeviceResponse response;
  EXPECT_TRUE(daemon.device->GetDevice(&context, {}, &response).ok());
  return response.servo().ticks();
}

TEST(Service, IsReadyOnceItServesAndFeedsTheWatchdog) {
  const Manager manager(milliseconds(400));
  Daemon daemon(test::kPalpated, {"--volume", "builtin:sphere:16"}, kService);
  EXPECT_EQ(manager.Next(kPatience), "STATUS=loading builtin:sphere:16");
  EXPECT_EQ(manager.Next(kPatience), "READY=1");
  EXPECT_TRUE(manager.Hears("STATUS=simulated, forces on; builtin:sphere:16"));
  for (int n = 0; n < 5; ++n) EXPECT_TRUE(manager.Hears("WATCHDOG=1"));
  EXPECT_EQ(daemon.End().exit_code, 0);
  EXPECT_TRUE(manager.Hears("STOPPING=1"));
}

// The daemon answers as ever, but its servo does not tick: systemd is to end it.
TEST(Service, AServoThatIsStuckStarvesTheWatchdog) {
  const Manager manager(milliseconds(400));
  Daemon daemon(test::kPalpated, {"--volume", "builtin:sphere:16"}, kService);
  ASSERT_TRUE(manager.Hears("WATCHDOG=1"));
  const pid_t servo = ServoThread(daemon.process().pid());
  ASSERT_GT(servo, 0);
  if (ptrace(PTRACE_SEIZE, servo, nullptr, nullptr) != 0) GTEST_SKIP() << "may not trace";
  ASSERT_EQ(ptrace(PTRACE_INTERRUPT, servo, nullptr, nullptr), 0);
  int status = 0;
  ASSERT_EQ(waitpid(servo, &status, __WALL), servo);
  const std::uint64_t ticks = Ticks(daemon);
  manager.Forget();
  // At most what was on its way when it stopped.
  int feeds = 0;
  for (const auto end = Clock::now() + seconds(2); Clock::now() < end;) {
    feeds += manager.Next(milliseconds(100)) == "WATCHDOG=1";
  }
  EXPECT_LE(feeds, 1);
  EXPECT_EQ(Ticks(daemon), ticks);
  ASSERT_EQ(ptrace(PTRACE_DETACH, servo, nullptr, nullptr), 0);
  EXPECT_TRUE(manager.Hears("WATCHDOG=1"));
}

TEST(Service, AReloadTakesOverWhatChangedInTheFileAndNothingElse) {
  const Manager manager(seconds(10));
  const ConfigFile config;
  config.Write("[haptics]\nstiffness_n_per_mm = 0.5\nviscosity_n_s_per_m = 1\n");
  Daemon daemon(test::kPalpated, {"--config", config.path()}, kService);
  v1::UpdateSettingsRequest request;
  request.mutable_settings()->set_viscosity_n_s_per_m(3.0);
  request.mutable_update_mask()->add_paths("viscosity_n_s_per_m");
  v1::UpdateSettingsResponse response;
  grpc::ClientContext context;
  ASSERT_TRUE(daemon.render->UpdateSettings(&context, request, &response).ok());
  const std::uint64_t ticks = Ticks(daemon);

  config.Write(
      "[haptics]\nviscosity_n_s_per_m = 1.0\nstiffness_n_per_mm = 0.8\n[realtime]\ncpu = 0\n");
  manager.Forget();
  daemon.process().Signal(SIGHUP);
  EXPECT_TRUE(manager.Hears("RELOADING=1\nMONOTONIC_USEC="));
  EXPECT_TRUE(manager.Hears("READY=1"));
  EXPECT_EQ(Settings(daemon).settings().stiffness_n_per_mm(), 0.8);
  // A client's, whose line in the file is as it was.
  EXPECT_EQ(Settings(daemon).settings().viscosity_n_s_per_m(), 3.0);
  EXPECT_GT(Ticks(daemon), ticks);
  const ProcessResult result = daemon.End();
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_NE(result.error.find("haptics.stiffness_n_per_mm taken over"), std::string::npos)
      << result.error;
  EXPECT_NE(result.error.find("realtime.cpu changed too: in force after a restart"),
            std::string::npos)
      << result.error;
}

TEST(Service, ABadFileChangesNothing) {
  const Manager manager(seconds(10));
  const ConfigFile config;
  config.Write("[haptics]\nstiffness_n_per_mm = 0.5\n");
  Daemon daemon(test::kPalpated, {"--config", config.path()}, kService);
  const std::vector<std::string> bad = {
      "[haptics]\nstiffness_n_per_mm = 0.9\npop_force_n = 99\n", "[haptics\n",
      // Fit for a file, but not for this volume: its values go from 0 to 1.
      "isovalue = 7\n[haptics]\nstiffness_n_per_mm = 0.9\n"};
  for (const std::string& text : bad) {
    config.Write(text);
    manager.Forget();
    daemon.process().Signal(SIGHUP);
    ASSERT_TRUE(manager.Hears("READY=1"));
    EXPECT_EQ(Settings(daemon).settings().stiffness_n_per_mm(), 0.5) << text;
  }
  // What is right again counts from what runs, not from what was refused.
  config.Write("[haptics]\nstiffness_n_per_mm = 0.9\n");
  manager.Forget();
  daemon.process().Signal(SIGHUP);
  ASSERT_TRUE(manager.Hears("READY=1"));
  EXPECT_EQ(Settings(daemon).settings().stiffness_n_per_mm(), 0.9);
  const std::string log = daemon.End().error;
  const std::string refused = "the configuration stays as it is: ";
  int lines = 0;
  for (std::size_t at = 0; (at = log.find(refused, at)) != std::string::npos; ++at) ++lines;
  EXPECT_EQ(lines, 3) << log;
  EXPECT_NE(log.find("palpated.toml:5: haptics.pop_force_n must be from"), std::string::npos)
      << log;
}

std::vector<std::string> Lines(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

// With a fault of a key, of a file that one names, of two together, and of an address.
const std::string kFaulty =
    "[haptics]\nstiffness_n_per_mm = 9\n[tls]\ncertificate = \"/no/such.pem\"\n"
    "[metrics]\nlisten = \"0.0.0.0:9464\"\n";
const std::vector<std::string> kFaults = {
    ":4: haptics.stiffness_n_per_mm must be from 0 to 3 N/mm",
    ":6: tls.certificate: cannot read /no/such.pem, or it is empty: correct the path, or who may "
    "read it",
    ":6: tls.certificate: tls.certificate and tls.key come together: set both, or none",
    ":8: metrics.listen: will not listen on 0.0.0.0:9464: metrics are neither encrypted nor "
    "authorised, and only loopback addresses are allowed (127.0.0.1, ::1)"};

// Those of kFaults, each behind `begin` and the file, and nothing else.
void ExpectFaults(const std::vector<std::string>& lines, const std::string& begin) {
  std::vector<std::string> expected;
  for (const std::string& fault : kFaults) expected.push_back(begin + fault);
  std::vector<std::string> sorted = lines;
  // Two of one line.
  std::sort(sorted.begin(), sorted.end());
  EXPECT_EQ(sorted, expected);
}

TEST(Service, ACheckAStartAndAReloadSayTheSameFaults) {
  const Manager manager(seconds(10));
  const ConfigFile config;
  config.Write("");
  Daemon daemon(test::kPalpated, {"--config", config.path()}, kService);
  config.Write(kFaulty);
  const TemporaryFolder folder;
  const std::vector<std::string> command = {
      test::kPalpated,  "--config", config.path(), "--socket", folder.path() / "s.sock",
      "--state-folder", ""};
  const ProcessResult start = Process(command).Wait();
  EXPECT_EQ(start.exit_code, 3);
  ExpectFaults(Lines(start.error), "palpated: " + config.path());
  std::vector<std::string> checked = command;
  checked.push_back("--check-config");
  const ProcessResult check = Process(checked).Wait();
  EXPECT_EQ(check.exit_code, 3);
  ExpectFaults(Lines(check.error), config.path());

  manager.Forget();
  daemon.process().Signal(SIGHUP);
  ASSERT_TRUE(manager.Hears("READY=1"));
  const std::string refused = "the configuration stays as it is: ";
  std::vector<std::string> logged;
  for (const std::string& line : Lines(daemon.End().error)) {
    const std::size_t at = line.find(refused);
    if (at != line.npos) logged.push_back(line.substr(at));
  }
  ExpectFaults(logged, refused + config.path());
}

// What another program has shows once it is wanted.
TEST(Service, AnAddressThatIsTakenNamesItsLine) {
  const ConfigFile config;
  config.Write("[server]\nlisten = \"127.0.0.1:" + std::to_string(FreePort()) + "\"\n");
  const Daemon first(test::kPalpated, {"--config", config.path()}, kService);
  const ProcessResult port = Process({test::kPalpated, "--config", config.path(), "--socket",
                                      first.socket().string() + "2", "--state-folder", ""})
                                 .Wait();
  EXPECT_EQ(port.exit_code, 7);
  EXPECT_NE(port.error.find("palpated: " + config.path() + ":4: server.listen: cannot listen on "),
            std::string::npos)
      << port.error;
  config.Write("[server]\nsocket = \"" + first.socket().string() + "\"\n");
  const ProcessResult socket =
      Process({test::kPalpated, "--config", config.path(), "--state-folder", ""}).Wait();
  EXPECT_EQ(socket.exit_code, 7);
  EXPECT_NE(socket.error.find("palpated: " + config.path() + ":4: server.socket: another palpated"),
            std::string::npos)
      << socket.error;
}

// The cylinder's values end below 0.99, which is known once it is there.
TEST(Service, WhatTheVolumeRefusesNamesItsLine) {
  const Manager manager(seconds(10));
  const ConfigFile config;
  const std::string cylinder = "[volume]\nsource = \"builtin:cylinder\"\n";
  std::ofstream(config.path()) << cylinder;
  Daemon daemon(test::kPalpated, {"--config", config.path()}, kService);
  std::ofstream(config.path()) << cylinder << "isovalue = 0.99\n";
  const TemporaryFolder folder;
  const ProcessResult start = Process({test::kPalpated, "--config", config.path(), "--socket",
                                       folder.path() / "s.sock", "--state-folder", ""})
                                  .Wait();
  EXPECT_EQ(start.exit_code, 3);
  const std::string fault = config.path() + ":3: volume.isovalue: isovalue 0.99 is not within 0 to";
  EXPECT_NE(start.error.find("palpated: " + fault), std::string::npos) << start.error;
  manager.Forget();
  daemon.process().Signal(SIGHUP);
  ASSERT_TRUE(manager.Hears("READY=1"));
  const std::string log = daemon.End().error;
  EXPECT_NE(log.find("stays as it is: " + fault), std::string::npos) << log;
  // What is no volume at all.
  std::ofstream(config.path()) << "[volume]\nsource = \"" << config.path() << "\"\n";
  const ProcessResult other = Process({test::kPalpated, "--config", config.path(), "--socket",
                                       folder.path() / "s.sock", "--state-folder", ""})
                                  .Wait();
  EXPECT_NE(other.exit_code, 0);
  EXPECT_NE(other.error.find("palpated: " + config.path() + ":2: volume.source: "),
            std::string::npos)
      << other.error;
}

TEST(Service, WithoutAFileAHangupEnds) {
  const TemporaryFolder folder;
  Process daemon({"/usr/bin/setsid", test::kPalpated, "--volume", "builtin:sphere:16", "--socket",
                  folder.path() / "s.sock", "--state-folder", ""});
  ASSERT_TRUE(daemon.WaitFor("ready on"));
  daemon.Signal(SIGHUP);
  EXPECT_EQ(daemon.Wait().exit_code, 0);
}

TEST(Service, TheJournalReadsLevels) {
  Daemon daemon(test::kPalpated, {"--volume", "builtin:sphere:16", "--log-to-journal"}, kService);
  const std::string log = daemon.End().error;
  EXPECT_TRUE(log.starts_with("<6>loading builtin:sphere:16\n")) << log;
  EXPECT_EQ(log.find('\x1b'), std::string::npos);
  const TemporaryFolder folder;
  const ProcessResult bad =
      Process({test::kPalpated, "--log-to-journal", "--volume", "builtin:cube", "--state-folder",
               "", "--socket", folder.path() / "s.sock"})
          .Wait();
  EXPECT_NE(bad.error.find("<3>palpated: "), std::string::npos) << bad.error;
}

TEST(Service, AConfigurationIsCheckedWithoutAStart) {
  const ConfigFile config;
  config.Write("[haptics]\nstiffness_n_per_mm = 0.9\n");
  const ProcessResult good =
      Process({test::kPalpated, "--check-config", "--config", config.path()}).Wait();
  EXPECT_EQ(good.exit_code, 0) << good.error;
  EXPECT_EQ(good.output, config.path() + ": ok\n");
  config.Write("[haptics]\nstiff = 0.9\nmethod = \"none\"\n");
  const ProcessResult bad =
      Process({test::kPalpated, "--check-config", "--config", config.path()}).Wait();
  EXPECT_EQ(bad.exit_code, 3);
  EXPECT_EQ(bad.output, "");
  EXPECT_TRUE(bad.error.starts_with(config.path() +
                                    ":4: haptics.stiff is no setting of palpated\n" +
                                    config.path() + ":5: haptics.method: "))
      << bad.error;
}

}  // namespace
}  // namespace palpate::test
