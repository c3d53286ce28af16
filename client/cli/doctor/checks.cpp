#include "client/cli/doctor/checks.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <linux/capability.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <toml++/toml.h>
#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>
#include <thread>

#include "client/cli/doctor/ports.h"
#include "client/cli/doctor/quota.h"

namespace palpate::doctor {
namespace {

namespace fs = std::filesystem;

constexpr int kServoPriority = 80;
constexpr std::uint64_t kGib = std::uint64_t{1} << 30;
// An hour of recording takes 360 MB.
constexpr std::uint64_t kLeastFreeBytes = kGib;
constexpr std::uint64_t kFreeBytes = 10 * kGib;
constexpr char kPlugIn[] = "plug it in and switch it on";

// Returns the first line of a file below the root, or "" if the file cannot be read.
std::string Line(const Workstation& machine, const std::string& path) {
  std::ifstream file(machine.root / path);
  std::string line;
  std::getline(file, line);
  while (!line.empty() && (line.back() == ' ' || line.back() == '\n')) line.pop_back();
  return line;
}

std::vector<fs::path> Entries(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> entries;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    entries.push_back(at->path());
  }
  std::sort(entries.begin(), entries.end());
  return entries;
}

// Returns the soft limit from /proc/self/limits, or "" if there is no limit of that name.
std::string Limit(const Workstation& machine, const std::string& name) {
  std::ifstream file(machine.root / "proc/self/limits");
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with(name)) continue;
    std::istringstream values(line.substr(name.size()));
    std::string soft;
    values >> soft;
    return soft;
  }
  return "";
}

int Number(const std::string& text, int otherwise) {
  int value = otherwise;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

// Checks this process. root has every capability, except in some containers.
bool HasCapability(const Workstation& machine, int number) {
  std::ifstream file(machine.root / "proc/self/status");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("CapEff:"))
      return (std::stoull(line.substr(7), nullptr, 16) >> number) & 1;
  }
  return false;
}

struct KnownDevice {
  const char* vendor;
  const char* product;
  const char* name;
  const char* kind;
};
// "" as product: all of this vendor.
constexpr std::array<KnownDevice, 5> kKnownDevices = {{
    {"2988", "0302", "Touch", "omni-usb"},
    {"2988", "0304", "Touch (HID)", "omni-usb"},
    {"0301", "2988", "Touch 3D Stylus", "omni-usb"},
    {"0403", "cb48", "Novint Falcon", "falcon"},
    {"1451", "", "Force Dimension device", "forcedimension"},
}};

// Returns null for a device that Palpate does not know.
const KnownDevice* Known(const std::string& vendor, const std::string& product) {
  const auto known = std::find_if(kKnownDevices.begin(), kKnownDevices.end(), [&](const auto& d) {
    return d.vendor == vendor && (d.product == product || *d.product == '\0');
  });
  return known == kKnownDevices.end() ? nullptr : &*known;
}

// The first of the files, by its folder; "": none is there.
std::string LibraryAt(const Workstation& machine, const std::string& name) {
  std::error_code error;
  if (name.starts_with('/')) return fs::exists(machine.root / name.substr(1), error) ? name : "";
  for (const char* folder : {"usr/lib", "usr/lib64", "usr/lib/x86_64-linux-gnu", "usr/local/lib"}) {
    const fs::path library = fs::path(folder) / name;
    if (fs::exists(machine.root / library, error)) return "/" + library.string();
  }
  return "";
}

Finding CheckUdevRule(const Workstation& machine) {
  for (const char* folder : {"etc/udev/rules.d", "usr/lib/udev/rules.d", "lib/udev/rules.d"}) {
    std::error_code error;
    if (fs::exists(machine.root / folder / "70-palpate.rules", error)) {
      return {"udev", Verdict::kOk, std::string("/") + folder + "/70-palpate.rules"};
    }
  }
  return {"udev", Verdict::kWarn, "no rule gives anybody but root the USB devices",
          "install palpate-daemon, or copy 70-palpate.rules to /etc/udev/rules.d"};
}

// What is missing is a fault where the kind in use needs it.
Finding Missing(const Workstation& machine, const char* check, const char* kind,
                const std::string& text, const std::string& advice) {
  if (machine.device_kind == kind) return {check, Verdict::kFail, text, advice, kind};
  return {check, Verdict::kOk, fmt::format("{}: only the device kind `{}` needs it", text, kind)};
}

// As palpated's importer does to hand over a volume.
int TryMemoryFile() {
  const int file = memfd_create("palpate-doctor", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (file < 0) return errno;
  const int failure = fcntl(file, F_ADD_SEALS, F_SEAL_WRITE) == 0 ? 0 : errno;
  close(file);
  return failure;
}

// Filters the calls of a thread that ends at once: a filter cannot be taken away again.
int TryCallFilter() {
  int failure = 0;
  std::thread([&failure] {
    sock_filter allow = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW);
    const sock_fprog filter{1, &allow};
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
        syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, 0, &filter) != 0) {
      failure = errno;
    }
  }).join();
  return failure;
}

}  // namespace

std::optional<std::string> Configured(const Workstation& machine, const std::string& section,
                                      const std::string& key) {
  try {
    const toml::table file =
        toml::parse_file((machine.root / "etc/palpate/palpated.toml").string());
    const auto value = file[section][key];
    if (const auto number = value.value_exact<std::int64_t>()) return std::to_string(*number);
    return value.value<std::string>();
  } catch (const toml::parse_error&) {
    return std::nullopt;  // no such file, or a broken one: 'palpated --check-config' explains it
  }
}

Workstation ThisMachine() {
  Workstation machine;
  const char* home = std::getenv("HOME");
  std::error_code error;
  machine.state_folder = "/var/lib/palpate";
  if (!fs::is_directory(machine.state_folder, error)) machine.state_folder = home ? home : "/";
  machine.may_write = [](const fs::path& path) { return access(path.c_str(), R_OK | W_OK) == 0; };
  machine.answers = Answers;
  machine.try_memory_file = TryMemoryFile;
  machine.try_call_filter = TryCallFilter;
  machine.free_bytes = [](const fs::path& path) {
    struct statvfs info {};
    if (statvfs(path.c_str(), &info) != 0) return std::uint64_t{0};
    return static_cast<std::uint64_t>(info.f_bavail) * info.f_frsize;
  };
  return machine;
}

Finding CheckKernel(const Workstation& machine) {
  const std::string release = Line(machine, "proc/sys/kernel/osrelease");
  const std::string version = Line(machine, "proc/version");
  if (Line(machine, "sys/kernel/realtime") == "1" ||
      version.find("PREEMPT_RT") != std::string::npos) {
    return {"kernel", Verdict::kOk, release + ", real-time (PREEMPT_RT)"};
  }
  if (Line(machine, "proc/cmdline").find("preempt=full") != std::string::npos) {
    return {"kernel", Verdict::kOk, release + ", preempt=full"};
  }
  return {"kernel", Verdict::kWarn, release + " is no real-time kernel: ticks are late at times",
          "install linux-image-rt-amd64, or boot with preempt=full"};
}

Finding CheckRealtimeRights(const Workstation& machine) {
  const std::string limit = Limit(machine, "Max realtime priority");
  if (Number(limit, 0) >= kServoPriority || limit == "unlimited") {
    return {"rtprio", Verdict::kOk, "real-time priority up to " + limit};
  }
  if (HasCapability(machine, CAP_SYS_NICE)) {
    return {"rtprio", Verdict::kOk, "this shell needs no limit for real-time priority"};
  }
  return {"rtprio", Verdict::kWarn,
          fmt::format("real-time priority up to {} for what this shell starts; the servo takes {}",
                      limit.empty() ? "0" : limit, kServoPriority),
          "use the service palpated, which has its own limit, or put `@palpate - rtprio 90` into "
          "/etc/security/limits.d/palpate.conf and log in again"};
}

Finding CheckLockedMemory(const Workstation& machine) {
  const std::string limit = Limit(machine, "Max locked memory");
  if (limit == "unlimited" || HasCapability(machine, CAP_IPC_LOCK)) {
    return {"memlock", Verdict::kOk, "memory may be locked"};
  }
  return {
      "memlock", Verdict::kWarn,
      "what this shell starts may lock " + (limit.empty() ? "no" : limit + " bytes of") + " memory",
      "use the service palpated, which has its own limit, or put `@palpate - memlock unlimited` "
      "into "
      "/etc/security/limits.d/palpate.conf and log in again"};
}

Finding CheckRealtimeShare(const Workstation& machine) {
  const int runtime_us = Number(Line(machine, "proc/sys/kernel/sched_rt_runtime_us"), -1);
  if (runtime_us == 0) {
    return {"rt-share", Verdict::kFail, "the kernel gives real-time threads no time",
            "sysctl kernel.sched_rt_runtime_us=950000"};
  }
  return {"rt-share", Verdict::kOk,
          runtime_us < 0
              ? "real-time threads have no limit"
              : fmt::format("real-time threads have {} us of each second's million", runtime_us)};
}

Finding CheckGovernor(const Workstation& machine) {
  std::string slow;
  int cores = 0;
  for (const fs::path& cpu : Entries(machine.root / "sys/devices/system/cpu")) {
    const fs::path file = cpu.lexically_relative(machine.root) / "cpufreq/scaling_governor";
    const std::string governor = Line(machine, file.string());
    if (governor.empty()) continue;
    ++cores;
    if (governor != "performance") slow = governor;
  }
  if (cores == 0) return {"governor", Verdict::kOk, "the cores' frequency is not scaled here"};
  if (slow.empty()) return {"governor", Verdict::kOk, "performance, on all cores"};
  return {"governor", Verdict::kWarn, slow + ": a core that slept wakes up slowly",
          "cpupower frequency-set --governor performance (package linux-cpupower)"};
}

Finding CheckClock(const Workstation& machine) {
  const std::string clock =
      Line(machine, "sys/devices/system/clocksource/clocksource0/current_clocksource");
  for (const char* good : {"tsc", "kvm-clock", "hyperv_clocksource_tsc_page", "arch_sys_counter"}) {
    if (clock == good) return {"clock", Verdict::kOk, clock};
  }
  return {"clock", Verdict::kWarn,
          (clock.empty() ? "unknown" : clock) + ": reading it takes microseconds",
          "see why the kernel gave up tsc: journalctl -k | grep -i clocksource"};
}

Finding CheckUsbDevices(const Workstation& machine) {
  if (machine.device_kind == "omni-usb") {
    return {"usb", Verdict::kFail, "the device kind `omni-usb` identifies a device, and no more",
            kDrivingKinds, "omni-usb"};
  }
  std::string found, found_kinds;
  for (const fs::path& device : Entries(machine.root / "sys/bus/usb/devices")) {
    const auto line = [&](const char* name) {
      return Line(machine, (device.lexically_relative(machine.root) / name).string());
    };
    const KnownDevice* known = Known(line("idVendor"), line("idProduct"));
    if (!known) continue;
    const fs::path node =
        machine.root / fmt::format("dev/bus/usb/{:03}/{:03}", Number(line("busnum"), 0),
                                   Number(line("devnum"), 0));
    const std::string name = std::string(known->name) + " at " + device.filename().string();
    if (!machine.may_write(node)) {
      return {"usb", Verdict::kFail, name + ": this user may not open it",
              "join the group palpate (usermod --append --groups palpate USER), log in again, "
              "and plug it in again",
              known->kind};
    }
    found += (found.empty() ? "" : ", ") + name;
    found_kinds += std::string(known->kind) + " ";
  }
  for (const KnownDevice& known : kKnownDevices) {
    if (machine.device_kind != known.kind || found_kinds.find(known.kind) != found_kinds.npos) {
      continue;
    }
    return {"usb", Verdict::kFail, std::string("no ") + known.name + " is plugged in", kPlugIn,
            known.kind};
  }
  return {"usb", Verdict::kOk,
          found.empty()
              ? "no known device is plugged in: no Touch, no Falcon, none of Force Dimension"
              : found};
}

Finding CheckFireWire(const Workstation& machine) {
  constexpr const char* kKind = "omni-firewire";
  constexpr const char* kVendor = "0x000b99";  // SensAble, who made the Phantom Omni
  bool has_controller = false;
  std::string found;
  for (const fs::path& device : Entries(machine.root / "sys/bus/firewire/devices")) {
    const std::string name = device.filename().string();
    if (!name.starts_with("fw") || name.find('.') != std::string::npos) continue;
    has_controller = true;
    const std::string folder = device.lexically_relative(machine.root).string();
    const bool is_omni = Line(machine, folder + "/guid").starts_with(kVendor) &&
                         Line(machine, folder + "/is_local") == "0";
    if (!is_omni) continue;
    if (!machine.may_write(machine.root / "dev" / name)) {
      return {"firewire", Verdict::kFail, "Phantom Omni at " + name + ": this user may not open it",
              "join the group palpate (usermod --append --groups palpate USER), log in again, "
              "and plug it in again",
              kKind};
    }
    found += (found.empty() ? "Phantom Omni at " : ", ") + name;
  }
  if (!has_controller) {
    return Missing(machine, "firewire", kKind, "no controller for FireWire",
                   "put in a FireWire card, or load its driver: modprobe firewire_ohci");
  }
  if (found.empty() && machine.device_kind == kKind) {
    return {"firewire", Verdict::kFail, "no Phantom Omni is plugged in", kPlugIn, kKind};
  }
  return {"firewire", Verdict::kOk, found.empty() ? "no Phantom Omni is plugged in" : found};
}

Finding CheckOpenHaptics(const Workstation& machine) {
  const std::string name =
      Configured(machine, "device", "openhaptics_library").value_or("libHD.so");
  const std::string library = LibraryAt(machine, name);
  if (!library.empty()) return {"libhd", Verdict::kOk, library};
  return Missing(
      machine, "libhd", "openhaptics", name + " is not installed",
      "install the vendor's driver and OpenHaptics, or set [device] openhaptics_library");
}

Finding CheckForceDimension(const Workstation& machine) {
  const std::string name =
      Configured(machine, "device", "forcedimension_library").value_or("libdrd.so.3");
  const std::string library = LibraryAt(machine, name);
  if (!library.empty()) return {"libdrd", Verdict::kOk, library};
  for (const fs::path& file : Entries(machine.root / "usr/local/lib")) {
    if (!file.filename().string().starts_with("libdrd.so.3.")) continue;
    return {"libdrd", Verdict::kFail,
            "/" + file.lexically_relative(machine.root).string() + " has no link libdrd.so.3",
            "run ldconfig as root", "forcedimension"};
  }
  return Missing(machine, "libdrd", "forcedimension", name + " is not installed",
                 "install the vendor's SDK as deploy/guides/force-dimension.md says, or set "
                 "[device] forcedimension_library");
}

Finding CheckHaply(const Workstation& machine) {
  constexpr int kPort = 10001;
  const int port = Number(Configured(machine, "device", "haply_port").value_or(""), kPort);
  if (machine.answers("127.0.0.1", static_cast<std::uint16_t>(port))) {
    return {"haply", Verdict::kOk, "the port of Haply's service answers"};
  }
  return Missing(machine, "haply", "haply", "Haply's service does not run",
                 "start it: systemctl start haply-inverse-service");
}

Finding CheckImporter(const Workstation& machine) {
  // Docker's own profile allows both to every container (moby's profiles/seccomp/default.json).
  constexpr const char* kAdvice =
      "where the container's profile refuses it (Docker 23 or later): docker run --security-opt "
      "seccomp=builtin ...; no --cap-add is needed";
  const auto refused = [](const char* call, int error, const char* consequence) {
    return fmt::format("{} is refused ({}): {}", call, std::strerror(error), consequence);
  };
  if (const int error = machine.try_memory_file(); error != 0) {
    return {"importer", Verdict::kFail, refused("memfd_create", error, "palpated can load no file"),
            kAdvice};
  }
  const int error = machine.try_call_filter();
  if (error == 0) {
    return {"importer", Verdict::kOk, "files in memory and filters of calls (seccomp) are allowed"};
  }
  // Such an answer means to the importer that the kernel has no seccomp.
  if (error == ENOSYS || error == EINVAL || error == EOPNOTSUPP) {
    return {"importer", Verdict::kWarn,
            refused("seccomp", error, "palpated reads files without a filter of system calls"),
            kAdvice};
  }
  return {"importer", Verdict::kFail, refused("seccomp", error, "palpated can load no file"),
          kAdvice};
}

Finding CheckSpace(const Workstation& machine) {
  const std::uint64_t bytes = machine.free_bytes(machine.state_folder);
  const std::string text = fmt::format("{:.1f} GiB free at {}", static_cast<double>(bytes) / kGib,
                                       machine.state_folder.string());
  if (bytes >= kFreeBytes) return {"space", Verdict::kOk, text};
  return {"space", bytes < kLeastFreeBytes ? Verdict::kFail : Verdict::kWarn, text,
          "an hour of recording takes 0.4 GB, an upload as much as its file: make room"};
}

Finding CheckSocket(const Workstation& machine, const fs::path& socket) {
  std::error_code error;
  if (!fs::exists(machine.root / socket.relative_path(), error)) {
    return {"socket", Verdict::kWarn,
            socket.string() + (error ? ": " + error.message() : " is not there"),
            "start palpated: systemctl start palpated; or name another with --socket"};
  }
  if (!machine.may_write(machine.root / socket.relative_path())) {
    return {"socket", Verdict::kFail, socket.string() + ": this user may not use it",
            "join its group (ls -l; usermod --append --groups GROUP USER) and log in again"};
  }
  return {"socket", Verdict::kOk, socket.string()};
}

std::vector<Finding> CheckWorkstation(const Workstation& machine) {
  return {CheckKernel(machine),        CheckRealtimeRights(machine), CheckLockedMemory(machine),
          CheckRealtimeShare(machine), CheckGovernor(machine),       CheckClock(machine),
          CheckUdevRule(machine),      CheckUsbDevices(machine),     CheckFireWire(machine),
          CheckOpenHaptics(machine),   CheckForceDimension(machine), CheckHaply(machine),
          CheckQuota(machine),         CheckImporter(machine),       CheckSpace(machine)};
}

}  // namespace palpate::doctor
