// Checks what a haptics workstation needs: kernel, rights, clock, devices, folders.
//
// Reads /proc, /sys, /dev and a few files below a root folder. A test can make up that folder.
// Threads: any. Errors: none. If something cannot be read, the finding says so.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace palpate::doctor {

enum class Verdict { kOk, kWarn, kFail };

// What to do about the kind `omni-usb`.
inline constexpr char kDrivingKinds[] =
    "set [device] kind to `openhaptics` for a Touch on USB, to `omni-firewire` for a Phantom Omni "
    "on FireWire; `omni-usb` decodes nothing and sends no force";

struct Finding {
  std::string name;  // what was checked, one word
  Verdict verdict = Verdict::kOk;
  std::string text;      // what was found, one line
  std::string advice{};  // what to do about it; empty if all is well
  // The kind of device that palpated cannot drive because of it; empty: of none alone.
  std::string kind{};
};

// The machine to check.
struct Workstation {
  std::filesystem::path root = "/";
  // The daemon's folder; empty: the daemon has none, or the folder is not known.
  std::filesystem::path state_folder{};
  std::function<bool(const std::filesystem::path&)> may_write;
  std::function<std::uint64_t(const std::filesystem::path&)> free_bytes;
  // See Answers in ports.h.
  std::function<bool(const std::string& host, std::uint16_t port)> answers;
  // Try what the importer needs. Return 0, or the number of the error (errno).
  std::function<int()> try_memory_file;
  std::function<int()> try_call_filter;
  // The kind of device that palpated drives here, or is to drive; empty: not known. What this kind
  // needs must be there; what only other kinds need may be missing.
  std::string device_kind{};
};
Workstation ThisMachine();

// Returns the value of /etc/palpate/palpated.toml, a number as text. Nothing if the file does not
// set it, or cannot be read.
std::optional<std::string> Configured(const Workstation& machine, const std::string& section,
                                      const std::string& key);

Finding CheckKernel(const Workstation& machine);
// Checks the limits of this shell. The service has limits of its own.
Finding CheckRealtimeRights(const Workstation& machine);
Finding CheckLockedMemory(const Workstation& machine);
// Checks the kernel's limit for real-time threads.
Finding CheckRealtimeShare(const Workstation& machine);
Finding CheckGovernor(const Workstation& machine);
Finding CheckClock(const Workstation& machine);
Finding CheckUsbDevices(const Workstation& machine);
// Looks for a Phantom Omni on FireWire. Most machines have no FireWire, and need none.
Finding CheckFireWire(const Workstation& machine);
// Look for what a vendor must have installed, which only the kind of this vendor needs.
Finding CheckOpenHaptics(const Workstation& machine);
Finding CheckForceDimension(const Workstation& machine);
Finding CheckHaply(const Workstation& machine);
Finding CheckSpace(const Workstation& machine);
// Checks whether the importer may be confined, and hand a volume over in memory. A container's
// profile may refuse both, of palpated as of this process, if they are in the same container.
Finding CheckImporter(const Workstation& machine);
// Checks that the socket exists and that this user may use it.
Finding CheckSocket(const Workstation& machine, const std::filesystem::path& socket);

// Runs all checks above except CheckSocket. Does not check the ports.
std::vector<Finding> CheckWorkstation(const Workstation& machine);

}  // namespace palpate::doctor
