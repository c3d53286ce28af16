// `palpate doctor` on machines that are made up.
#include "client/cli/doctor/ports.h"
#include "client/cli/doctor/quota.h"

#include <gtest/gtest.h>

#include <cerrno>
#include <fstream>
#include <set>

#include "tests/support/temporary_folder.h"

namespace palpate::doctor {
namespace {

class DoctorTest : public ::testing::Test {
 protected:
  DoctorTest() {
    machine_.root = folder_.path();
    machine_.state_folder = "/var/lib/palpate";
    machine_.may_write = [this](const std::filesystem::path& path) {
      return writable_.contains(path.lexically_relative(folder_.path()).string());
    };
    machine_.answers = [this](const std::string& host, std::uint16_t port) {
      return answering_.contains(host + ":" + std::to_string(port));
    };
    machine_.free_bytes = [this](const std::filesystem::path&) { return free_bytes_; };
    machine_.try_memory_file = [this] { return memory_file_error_; };
    machine_.try_call_filter = [this] { return call_filter_error_; };
  }
  void Put(const std::string& path, const std::string& text) const {
    std::filesystem::create_directories((folder_.path() / path).parent_path());
    std::ofstream(folder_.path() / path) << text << "\n";
  }
  void PutTouch(const std::string& product = "0302") const {
    Put("sys/bus/usb/devices/1-2/idVendor", "2988");
    Put("sys/bus/usb/devices/1-2/idProduct", product);
    Put("sys/bus/usb/devices/1-2/busnum", "1");
    Put("sys/bus/usb/devices/1-2/devnum", "7");
  }

  // Something listens on the port, whose process may be seen.
  void PutListener(const std::string& port_hex, const std::string& program) const {
    Put("proc/net/tcp",
        "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  "
        "timeout inode\n"
        "   0: 0100007F:1CE8 0100007F:D431 01 00000000:00000000 00:00000000 00000000  1000        "
        "0 77 1\n"
        "   1: 0100007F:" +
            port_hex +
            " 00000000:0000 0A 00000000:00000000 00:00000000 00000000   117        0 4711 1");
    if (program.empty()) return;
    Put("proc/42/comm", program);
    std::filesystem::create_directories(folder_.path() / "proc/42/fd");
    std::filesystem::create_symlink("socket:[4711]", folder_.path() / "proc/42/fd/9");
  }

  test::TemporaryFolder folder_;
  Workstation machine_;
  std::set<std::string> writable_;
  std::set<std::string> answering_;
  std::uint64_t free_bytes_ = std::uint64_t{100} << 30;
  int memory_file_error_ = 0, call_filter_error_ = 0;
};

// What is not ok says what to do.
void ExpectAdvice(const Finding& finding, Verdict verdict, const std::string& part = "") {
  EXPECT_EQ(finding.verdict, verdict) << finding.text;
  EXPECT_EQ(finding.advice.empty(), verdict == Verdict::kOk) << finding.text;
  EXPECT_FALSE(finding.text.empty());
  EXPECT_NE(finding.text.find(part), std::string::npos) << finding.text;
}

TEST_F(DoctorTest, AGoodMachineIsOk) {
  Put("proc/sys/kernel/osrelease", "6.1.0-rt-amd64");
  Put("proc/version", "Linux version 6.1.0-rt-amd64 #1 SMP PREEMPT_RT Debian");
  Put("proc/self/limits",
      "Limit                     Soft Limit           Hard Limit           Units\n"
      "Max locked memory         unlimited            unlimited            bytes\n"
      "Max realtime priority     90                   90");
  Put("proc/sys/kernel/sched_rt_runtime_us", "950000");
  Put("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance");
  Put("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc");
  Put("usr/lib/udev/rules.d/70-palpate.rules", "");
  PutTouch();
  writable_ = {"dev/bus/usb/001/007"};
  const std::vector<Finding> findings = CheckWorkstation(machine_);
  EXPECT_EQ(findings.size(), 15u);
  for (const Finding& finding : findings) ExpectAdvice(finding, Verdict::kOk);
}

TEST_F(DoctorTest, AnEmptyMachineIsSurvived) {
  for (const Finding& finding : CheckWorkstation(machine_)) {
    EXPECT_EQ(finding.advice.empty(), finding.verdict == Verdict::kOk) << finding.name;
  }
}

TEST_F(DoctorTest, ReadsTheMachinesFiles) {
  using Check = Finding (*)(const Workstation&);
  struct Case {
    std::string path, text;
    Check check;
    Verdict verdict;
    std::string part;
  };
  constexpr Verdict kOk = Verdict::kOk, kWarn = Verdict::kWarn, kFail = Verdict::kFail;
  Put("proc/sys/kernel/osrelease", "6.1.0-amd64");
  Put("proc/version", "Linux version 6.1.0-amd64 #1 SMP PREEMPT_DYNAMIC Debian");
  const std::string memory = "Max locked memory   8388608   unlimited   bytes\n";
  const std::string cpus = "sys/devices/system/cpu/cpu";
  const std::string clock = "sys/devices/system/clocksource/clocksource0/current_clocksource";
  // One after the other: what was put stays.
  for (const auto& [path, text, check, verdict, part] : std::vector<Case>{
           {"proc/cmdline", "root=/dev/sda1 quiet", CheckKernel, kWarn, ""},
           {"proc/cmdline", "root=/dev/sda1 preempt=full quiet", CheckKernel, kOk, ""},
           {"proc/cmdline", "", CheckKernel, kWarn, ""},
           {"sys/kernel/realtime", "1", CheckKernel, kOk, ""},
           {"proc/sys/kernel/sched_rt_runtime_us", "0", CheckRealtimeShare, kFail, ""},
           {"proc/sys/kernel/sched_rt_runtime_us", "-1", CheckRealtimeShare, kOk, ""},
           // One slow core is enough.
           {cpus + "0/cpufreq/scaling_governor", "performance", CheckGovernor, kOk, ""},
           {cpus + "1/cpufreq/scaling_governor", "powersave", CheckGovernor, kWarn, "powersave"},
           {clock, "hpet", CheckClock, kWarn, "hpet"},
           // The soft limits count.
           {"proc/self/limits", memory + "Max realtime priority   79   90", CheckRealtimeRights,
            kWarn, "79"},
           {"proc/self/limits", memory + "Max realtime priority   80   80", CheckRealtimeRights,
            kOk, ""},
           {"proc/self/limits", memory, CheckLockedMemory, kWarn, "8388608"},
           // Root needs no limits; some containers have SYS_NICE alone.
           {"proc/self/limits", memory + "Max realtime priority   0   0", CheckRealtimeRights,
            kWarn, ""},
           {"proc/self/status", "CapPrm:\t000001ffffffffff\nCapEff:\t0000000000000000",
            CheckRealtimeRights, kWarn, ""},
           {"proc/self/status", "CapEff:\t0000000000800000", CheckRealtimeRights, kOk, ""},
           {"proc/self/status", "CapEff:\t0000000000800000", CheckLockedMemory, kWarn, ""},
           {"proc/self/status", "CapEff:\t000001ffffffffff", CheckLockedMemory, kOk, ""}}) {
    Put(path, text);
    SCOPED_TRACE(path + ": " + text);
    ExpectAdvice(check(machine_), verdict, part);
  }
}

TEST_F(DoctorTest, APortIsFreeOrPalpateds) {
  ExpectAdvice(CheckPort(machine_), Verdict::kOk);
  ExpectAdvice(CheckMetricsPort(machine_), Verdict::kOk);
  // Of another user: it may be palpated's.
  PutListener("1CE8", "");
  ExpectAdvice(CheckPort(machine_), Verdict::kWarn, "117");
  // 7400; the connection with that port in the table is no listener.
  PutListener("1CE8", "palpated");
  ExpectAdvice(CheckPort(machine_), Verdict::kFail);
  answering_ = {"127.0.0.1:7400"};
  ExpectAdvice(CheckPort(machine_), Verdict::kOk, "127.0.0.1:7400: ");
  ExpectAdvice(CheckMetricsPort(machine_), Verdict::kOk, "9464 is free");
}

TEST_F(DoctorTest, PortsOfTheDaemonThatRunsAreLookedAt) {
  EXPECT_TRUE(CheckDaemonPorts(machine_).empty());
  PutListener("1CF3", "palpated");  // 7411, which no configuration names
  ASSERT_EQ(CheckDaemonPorts(machine_).size(), 1u);
  ExpectAdvice(CheckDaemonPorts(machine_)[0], Verdict::kFail);
  answering_ = {"127.0.0.1:7411"};
  ExpectAdvice(CheckDaemonPorts(machine_)[0], Verdict::kOk);
  // Of another address, by IPv6.
  Put("proc/net/tcp6",
      "   1: B80D0120000000000000000001000000:1CF4 00000000000000000000000000000000:0000 0A "
      "00000000:00000000 00:00000000 00000000   117        0 4711 1");
  answering_ = {"127.0.0.1:7411", "[2001:db8::1]:7412"};
  ASSERT_EQ(CheckDaemonPorts(machine_).size(), 2u);
  ExpectAdvice(CheckDaemonPorts(machine_)[1], Verdict::kOk, "[2001:db8::1]:7412: ");
  std::filesystem::remove(folder_.path() / "proc/net/tcp6");
  Put("etc/palpate/palpated.toml", "[server]\nlisten = \"127.0.0.1:7411\"\n");
  EXPECT_TRUE(CheckDaemonPorts(machine_).empty());  // CheckPort has it
}

TEST_F(DoctorTest, APortThatAnotherProgramHasFailsWhereItIsWanted) {
  PutListener("1CE9", "nginx");
  ExpectAdvice(CheckPort(machine_), Verdict::kOk);
  Put("etc/palpate/palpated.toml", "[server]\nlisten = \"0.0.0.0:7401\"\n");
  ExpectAdvice(CheckPort(machine_), Verdict::kFail, "nginx");
  Put("etc/palpate/palpated.toml", "[metrics]\nlisten = \"[::1]:7401\"\n");
  ExpectAdvice(CheckPort(machine_), Verdict::kOk);
  ExpectAdvice(CheckMetricsPort(machine_), Verdict::kFail);
  Put("etc/palpate/palpated.toml", "[metrics]\nlisten = \"nonsense\"\n");
  ExpectAdvice(CheckMetricsPort(machine_), Verdict::kFail);
}

TEST_F(DoctorTest, ADeviceThatMayNotBeOpenedFails) {
  PutTouch();
  ExpectAdvice(CheckUsbDevices(machine_), Verdict::kFail, "Touch at 1-2");
  writable_ = {"dev/bus/usb/001/007"};
  ExpectAdvice(CheckUsbDevices(machine_), Verdict::kOk);
  PutTouch("9999");
  ExpectAdvice(CheckUsbDevices(machine_), Verdict::kOk, "no known device");
  PutTouch("0402");
  Put("sys/bus/usb/devices/1-2/idVendor", "1451");
  ExpectAdvice(CheckUsbDevices(machine_), Verdict::kOk, "Force Dimension");
}

TEST_F(DoctorTest, AnOmniOnFireWireMustBeOpened) {
  ExpectAdvice(CheckFireWire(machine_), Verdict::kOk, "no controller");
  const std::string bus = "sys/bus/firewire/devices/";
  Put(bus + "fw0/guid", "0x000b9900004d0000");  // the controller may be of any vendor
  Put(bus + "fw0/is_local", "1");
  Put(bus + "fw1/guid", "0x0011223344556677");
  Put(bus + "fw1/is_local", "0");
  Put(bus + "fw2.0/guid", "0x000b9900004d1234");  // a unit, which has no node
  Put(bus + "fw2.0/is_local", "0");
  ExpectAdvice(CheckFireWire(machine_), Verdict::kOk, "no Phantom Omni");
  Put(bus + "fw2/guid", "0x000b9900004d1234");
  Put(bus + "fw2/is_local", "0");
  ExpectAdvice(CheckFireWire(machine_), Verdict::kFail, "fw2");
  writable_ = {"dev/fw2"};
  ExpectAdvice(CheckFireWire(machine_), Verdict::kOk, "fw2");
}

TEST_F(DoctorTest, WhatVendorsInstallIsOptional) {
  ExpectAdvice(CheckOpenHaptics(machine_), Verdict::kOk, "not installed");
  Put("usr/lib/libHD.so", "");
  ExpectAdvice(CheckOpenHaptics(machine_), Verdict::kOk, "/usr/lib/libHD.so");
  ExpectAdvice(CheckForceDimension(machine_), Verdict::kOk, "not installed");
  Put("usr/local/lib/libdrd.so.3.17.5", "");
  ExpectAdvice(CheckForceDimension(machine_), Verdict::kFail, "no link");
  Put("usr/local/lib/libdrd.so.3", "");
  ExpectAdvice(CheckForceDimension(machine_), Verdict::kOk, "/usr/local/lib/libdrd.so.3");
  ExpectAdvice(CheckHaply(machine_), Verdict::kOk, "does not run");
}

TEST_F(DoctorTest, WhatTheKindInUseNeedsMustBeThere) {
  using Check = Finding (*)(const Workstation&);
  for (const auto& [kind, check] :
       std::vector<std::pair<std::string, Check>>{{"haply", CheckHaply},
                                                  {"openhaptics", CheckOpenHaptics},
                                                  {"forcedimension", CheckForceDimension},
                                                  {"forcedimension", CheckUsbDevices},
                                                  {"falcon", CheckUsbDevices},
                                                  {"omni-usb", CheckUsbDevices},
                                                  {"omni-firewire", CheckFireWire}}) {
    SCOPED_TRACE(kind);
    machine_.device_kind = "simulated";
    ExpectAdvice(check(machine_), Verdict::kOk);
    machine_.device_kind = kind;
    ExpectAdvice(check(machine_), Verdict::kFail);
    EXPECT_EQ(check(machine_).kind, kind);
  }
  Put("etc/palpate/palpated.toml",
      "[device]\nhaply_port = 4711\nopenhaptics_library = \"/opt/libHD.so\"\n");
  Put("opt/libHD.so", "");
  answering_ = {"127.0.0.1:4711"};
  machine_.device_kind = "haply";
  ExpectAdvice(CheckHaply(machine_), Verdict::kOk);
  machine_.device_kind = "openhaptics";
  ExpectAdvice(CheckOpenHaptics(machine_), Verdict::kOk, "/opt/libHD.so");
}

TEST_F(DoctorTest, ARefusedImporterIsToldWhatDockerMustAllow) {
  memory_file_error_ = EPERM;
  ExpectAdvice(CheckImporter(machine_), Verdict::kFail, "memfd_create");
  EXPECT_NE(CheckImporter(machine_).advice.find("--security-opt seccomp="), std::string::npos);
  memory_file_error_ = 0;
  call_filter_error_ = EPERM;
  ExpectAdvice(CheckImporter(machine_), Verdict::kFail, "seccomp");
  call_filter_error_ = ENOSYS;  // the importer goes on without its filter
  ExpectAdvice(CheckImporter(machine_), Verdict::kWarn, "seccomp");
}

TEST(CpuQuota, IsParsedAndJunkIsNone) {
  EXPECT_DOUBLE_EQ(ParseCpuMax("50000 100000\n")->processors(), 0.5);
  for (const char* none : {"max 100000\n", "", "50000", "50000 0", "-1 100000", "x y"}) {
    EXPECT_FALSE(ParseCpuMax(none)) << none;
  }
  const Throttling some = ParseCpuStat(
      "usage_usec 9\nnr_periods 340\nnr_throttled 12\nthrottled_usec 1200000\nnr_bursts 3\n");
  EXPECT_EQ(some.periods, 340u);
  EXPECT_EQ(some.throttled, 12u);
  EXPECT_EQ(some.stopped_us, 1'200'000u);
  EXPECT_EQ(ParseCpuStat("usage_usec 9").throttled, 0u);
  EXPECT_EQ(ParseCgroup("0::/a.slice/b.service\n"), "/a.slice/b.service");
  EXPECT_FALSE(ParseCgroup("3:cpu,cpuacct:/a\n0::/\n"));
  EXPECT_FALSE(ParseCgroup(""));
}

TEST_F(DoctorTest, AQuotaOfTheDaemonOrOfItsParentIsToldWithItsNumbers) {
  Put("proc/self/cgroup", "0::/user.slice");
  Put("sys/fs/cgroup/user.slice/cpu.max", "max 100000");
  ExpectAdvice(CheckQuota(machine_), Verdict::kOk);
  Put("proc/42/comm", "palpated");
  Put("proc/42/cgroup", "0::/system.slice/palpated.service");
  Put("sys/fs/cgroup/system.slice/palpated.service/cpu.max", "150000 100000");
  Put("sys/fs/cgroup/system.slice/cpu.max", "50000 100000");
  Put("sys/fs/cgroup/system.slice/cpu.stat", "nr_periods 340\nnr_throttled 12");
  ExpectAdvice(CheckQuota(machine_), Verdict::kWarn, "0.5 processors");
  ExpectAdvice(CheckQuota(machine_), Verdict::kWarn, "12 of 340");
  EXPECT_NE(CheckQuota(machine_).advice.find("CPUQuota="), std::string::npos);
}

TEST_F(DoctorTest, SpaceRunsOutInSteps) {
  ExpectAdvice(CheckSpace(machine_), Verdict::kOk);
  free_bytes_ = std::uint64_t{5} << 30;
  ExpectAdvice(CheckSpace(machine_), Verdict::kWarn);
  free_bytes_ = std::uint64_t{500} << 20;
  ExpectAdvice(CheckSpace(machine_), Verdict::kFail);
}

TEST_F(DoctorTest, TellsASocketThatIsMissingFromOneThatIsForbidden) {
  ExpectAdvice(CheckSocket(machine_, "/run/palpate/palpated.sock"), Verdict::kWarn);
  Put("run/palpate/palpated.sock", "");
  ExpectAdvice(CheckSocket(machine_, "/run/palpate/palpated.sock"), Verdict::kFail);
  writable_ = {"run/palpate/palpated.sock"};
  ExpectAdvice(CheckSocket(machine_, "/run/palpate/palpated.sock"), Verdict::kOk);
}

}  // namespace
}  // namespace palpate::doctor
