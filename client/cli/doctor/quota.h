// Checks whether a quota of processor time slows palpated: systemd's CPUQuota=, Docker's --cpus.
//
// Threads: any. Errors: none. Apart for its tests.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "client/cli/doctor/checks.h"

namespace palpate::doctor {

// The processor time of a cgroup in each period, all its threads and processors together.
struct CpuQuota {
  std::int64_t quota_us = 0;
  std::int64_t period_us = 0;

  double processors() const {
    return static_cast<double>(quota_us) / static_cast<double>(period_us);
  }
};

// Parses cpu.max of cgroup v2, such as "50000 100000". Nothing if there is no limit ("max"), or if
// the text is something else.
std::optional<CpuQuota> ParseCpuMax(std::string_view text);

struct Throttling {
  std::uint64_t periods = 0;    // in which the cgroup wanted to run
  std::uint64_t throttled = 0;  // of these, in which its quota was used up
  std::uint64_t stopped_us = 0;
};
// Parses cpu.stat of cgroup v2. What the text does not have is 0.
Throttling ParseCpuStat(std::string_view text);

// Parses /proc/PID/cgroup. Returns the path in cgroup v2; nothing if there is none, or if cgroup v1
// has the processors.
std::optional<std::string> ParseCgroup(std::string_view text);

// Looks at each palpated that runs here, and at this process. The quota of a parent counts, too.
Finding CheckQuota(const Workstation& machine);

}  // namespace palpate::doctor
