#include "client/cli/doctor/quota.h"

#include <fmt/core.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <sstream>
#include <vector>

namespace palpate::doctor {
namespace {

namespace fs = std::filesystem;

std::string TextOf(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

// The tightest quota among a cgroup and its parents, and the cgroup that has it.
struct Limited {
  CpuQuota quota;
  std::string cgroup;
  Throttling throttling;
};

std::optional<Limited> LimitOf(const Workstation& machine, const std::string& cgroup) {
  std::optional<Limited> tightest;
  const fs::path root = machine.root / "sys/fs/cgroup";
  for (fs::path at = cgroup;; at = at.parent_path()) {
    const fs::path folder = root / at.relative_path();
    const std::optional<CpuQuota> quota = ParseCpuMax(TextOf(folder / "cpu.max"));
    if (quota && (!tightest || quota->processors() < tightest->quota.processors())) {
      tightest = {*quota, at.string(), ParseCpuStat(TextOf(folder / "cpu.stat"))};
    }
    if (at == at.parent_path()) return tightest;
  }
}

// The folders in /proc of each palpated, and then of this process.
std::vector<fs::path> Processes(const Workstation& machine) {
  std::vector<fs::path> processes;
  std::error_code error;
  fs::directory_iterator at(machine.root / "proc", error);
  for (; !error && at != fs::directory_iterator(); at.increment(error)) {
    if (TextOf(at->path() / "comm") == "palpated\n") processes.push_back(at->path());
  }
  processes.push_back(machine.root / "proc/self");
  return processes;
}

Finding Describe(const std::string& process, const Limited& limited) {
  const Throttling& seen = limited.throttling;
  return {
      "quota", Verdict::kWarn,
      fmt::format("{} may use {:.3g} processors: {} of each {} us, by cpu.max of {}; throttled "
                  "in {} of {} periods, for {:.1f} s in all",
                  process, limited.quota.processors(), limited.quota.quota_us,
                  limited.quota.period_us, limited.cgroup, seen.throttled, seen.periods,
                  static_cast<double>(seen.stopped_us) * 1e-6),
      "take the quota away. A service: systemctl set-property palpated CPUQuota= (nothing after "
      "the =). A container: start it without --cpus and --cpu-quota"};
}

}  // namespace

std::optional<CpuQuota> ParseCpuMax(std::string_view text) {
  std::istringstream numbers{std::string(text)};
  CpuQuota quota;
  if (!(numbers >> quota.quota_us >> quota.period_us)) return std::nullopt;
  if (quota.quota_us <= 0 || quota.period_us <= 0) return std::nullopt;
  return quota;
}

Throttling ParseCpuStat(std::string_view text) {
  Throttling throttling;
  std::istringstream lines{std::string(text)};
  std::string name;
  for (std::uint64_t number = 0; lines >> name >> number;) {
    if (name == "nr_periods") throttling.periods = number;
    if (name == "nr_throttled") throttling.throttled = number;
    if (name == "throttled_usec") throttling.stopped_us = number;
  }
  return throttling;
}

std::optional<std::string> ParseCgroup(std::string_view text) {
  std::optional<std::string> path;
  std::istringstream lines{std::string(text)};
  for (std::string line; std::getline(lines, line);) {
    // hierarchy:controllers:path. Hierarchy 0 is cgroup v2, without controllers here.
    if (line.starts_with("0::")) path = line.substr(3);
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (second == line.npos) continue;
    const std::string controllers = "," + line.substr(first + 1, second - first - 1) + ",";
    if (controllers.find(",cpu,") != controllers.npos) return std::nullopt;
  }
  return path;
}

Finding CheckQuota(const Workstation& machine) {
  bool is_known = false;
  for (const fs::path& process : Processes(machine)) {
    const std::optional<std::string> cgroup = ParseCgroup(TextOf(process / "cgroup"));
    if (!cgroup) continue;
    is_known = true;
    const std::optional<Limited> limited = LimitOf(machine, *cgroup);
    const bool is_this = process.filename() == "self";
    if (limited) return Describe(is_this ? "what this shell starts" : "palpated", *limited);
  }
  return {
      "quota", Verdict::kOk,
      is_known ? "no quota of processor time" : "not known: the processors are not in cgroup v2"};
}

}  // namespace palpate::doctor
