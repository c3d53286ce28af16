// Checks what a haptics workstation needs: kernel, rights, clock, devices, folders.
//
// Reads /proc, /sys, /dev and a few files below a root folder. A test can make up that folder.
// Threads: any. Errors: none. If something cannot be read, the finding says so.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace palpate::doctor {

enum class Verdict { kOk, kWarn, kFail };

struct Finding {
  std::string name;  // what was checked, one word
  Verdict verdict = Verdict::kOk;
  std::string text;      // what was found, one line
  std::string advice{};  // what to do about it; empty if all is well
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
};
Workstation ThisMachine();

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
// Checks that the socket exists and that this user may use it.
Finding CheckSocket(const Workstation& machine, const std::filesystem::path& socket);

// Runs all checks above except CheckSocket. Does not check the ports.
std::vector<Finding> CheckWorkstation(const Workstation& machine);

}  // namespace palpate::doctor
