// What a haptics workstation needs, looked up: kernel, rights, clock, devices, folders.
//
// Reads /proc, /sys, /dev and a few files below a root folder, which a test can make
// up. Threads: any. Errors: none; what cannot be read is said in the finding.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace palpate::doctor {

enum class Verdict { kOk, kWarn, kFail };

struct Finding {
  std::string name;  // of what was checked, one word
  Verdict verdict = Verdict::kOk;
  std::string text;      // what was found, one line
  std::string advice{};  // what to do about it; empty where all is well
};

// The machine that is looked at.
struct Workstation {
  std::filesystem::path root = "/";
  // Of the daemon; empty: it has none, or nobody knows it.
  std::filesystem::path state_folder{};
  std::function<bool(const std::filesystem::path&)> may_write;
  std::function<std::uint64_t(const std::filesystem::path&)> free_bytes;
  // As Answers of ports.h.
  std::function<bool(const std::string& host, std::uint16_t port, const std::string& text)> answers;
};
Workstation ThisMachine();

Finding CheckKernel(const Workstation& machine);
// Of this shell: the service has rights of its own.
Finding CheckRealtimeRights(const Workstation& machine);
Finding CheckLockedMemory(const Workstation& machine);
Finding CheckRealtimeShare(const Workstation& machine);  // of the kernel
Finding CheckGovernor(const Workstation& machine);
Finding CheckClock(const Workstation& machine);
Finding CheckUdevRule(const Workstation& machine);
Finding CheckUsbDevices(const Workstation& machine);
Finding CheckSpace(const Workstation& machine);
// A socket that is there, and that this user may not use.
Finding CheckSocket(const Workstation& machine, const std::filesystem::path& socket);

// All but the last, and the ports.
std::vector<Finding> CheckWorkstation(const Workstation& machine);

}  // namespace palpate::doctor
