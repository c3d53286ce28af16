#include "server/live_volume/memory_budget.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <string_view>
#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

// What palpated takes without a volume, stacks and libraries locked into memory.
constexpr std::uint64_t kProcessBytes = std::uint64_t{192} << 20;

// Rounds up, so that a message never names less than what is needed.
std::string Mib(std::uint64_t bytes) {
  return std::to_string((bytes >> 20) + ((bytes & 0xfffff) != 0)) + " MiB";
}

}  // namespace

MemoryClaim::MemoryClaim(MemoryClaim&& other) noexcept { *this = std::move(other); }

MemoryClaim& MemoryClaim::operator=(MemoryClaim&& other) noexcept {
  std::swap(budget_, other.budget_);
  std::swap(holder_, other.holder_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

MemoryClaim::~MemoryClaim() {
  if (budget_) budget_->Change(holder_, bytes_, 0);
}

void MemoryClaim::Resize(std::uint64_t bytes) {
  budget_->Change(holder_, bytes_, bytes);
  bytes_ = bytes;
}

MemoryClaim MemoryBudget::Claim(const std::string& holder, std::uint64_t bytes) {
  Change(holder, 0, bytes);
  MemoryClaim claim;
  claim.budget_ = shared_from_this();
  claim.holder_ = holder;
  claim.bytes_ = bytes;
  return claim;
}

void MemoryBudget::SetPart(const std::string& part, std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  if (bytes == 0) {
    parts_.erase(part);
  } else {
    parts_[part] = bytes;
  }
}

void MemoryBudget::SetWait(WaitForFreed wait) {
  const std::lock_guard lock(mutex_);
  wait_ = std::move(wait);
}

std::uint64_t MemoryBudget::held_bytes() const {
  const std::lock_guard lock(mutex_);
  return HeldLocked();
}

std::uint64_t MemoryBudget::left_bytes() const {
  const std::uint64_t held = held_bytes();
  return held < bytes_ ? bytes_ - held : 0;
}

std::uint64_t MemoryBudget::HeldLocked() const {
  std::uint64_t sum = live_ ? live_() : 0;
  for (const auto& [holder, bytes] : held_) sum += bytes;
  return sum;
}

void MemoryBudget::Change(const std::string& holder, std::uint64_t from, std::uint64_t to) {
  if (TryChange(holder, from, to)) return;
  WaitForFreed wait;
  {
    const std::lock_guard lock(mutex_);
    wait = wait_;
  }
  if (wait) {
    wait(kPatience);
    if (TryChange(holder, from, to)) return;
  }
  const std::lock_guard lock(mutex_);
  throw Error(ErrorKind::kTooLarge, Refusal(holder, from, to));
}

// Shrinking always succeeds, even above the budget: live bricks that nobody claimed may exceed it.
bool MemoryBudget::TryChange(const std::string& holder, std::uint64_t from, std::uint64_t to) {
  const std::lock_guard lock(mutex_);
  if (to > from) {
    const std::uint64_t others = HeldLocked() - from;
    if (to > bytes_ || others > bytes_ - to) return false;
  }
  AddLocked(holder, to - from);
  return true;
}

void MemoryBudget::AddLocked(const std::string& holder, std::uint64_t difference) {
  const auto entry = held_.try_emplace(holder, 0).first;
  entry->second += difference;
  if (entry->second == 0) held_.erase(entry);
}

std::string MemoryBudget::Refusal(const std::string& holder, std::uint64_t from,
                                  std::uint64_t to) const {
  std::map<std::string, std::uint64_t> holders = held_;
  for (const auto& [part, bytes] : parts_) holders[part] += bytes;
  std::uint64_t others = live_ ? live_() : 0;
  for (const auto& [part, bytes] : parts_) others -= std::min(others, bytes);
  if (others > 0) holders["other bricks"] += others;
  std::string list;
  for (const auto& [name, bytes] : holders) {
    list += (list.empty() ? " (" : ", ") + name + " " + Mib(bytes);
  }
  if (!list.empty()) list += ")";
  return holder + " needs " + Mib(to) + "; of the memory budget of " + Mib(bytes_) + ", " +
         Mib(HeldLocked() - from) + " are held" + list +
         ": load something smaller first, crop the data, or raise " + kKey;
}

std::uint64_t CgroupLimitBytes(const std::filesystem::path& cgroups, std::istream& own) {
  std::uint64_t least = std::numeric_limits<std::uint64_t>::max();
  // Lines such as "0::/system.slice/palpated.service" (v2) and "9:memory:/user.slice" (v1).
  for (std::string line; std::getline(own, line);) {
    const std::size_t controllers = line.find(':'), path = line.find(':', controllers + 1);
    if (path == std::string::npos) continue;
    const std::string_view named = std::string_view(line).substr(0, path).substr(controllers + 1);
    const bool is_v2 = named.empty();
    if (!is_v2 && named != "memory") continue;
    const auto root = is_v2 ? cgroups : cgroups / "memory";
    // Each folder above limits, too. In a container only the root is there.
    for (std::filesystem::path at = line.substr(path + 2);; at = at.parent_path()) {
      std::ifstream file(root / at / (is_v2 ? "memory.max" : "memory.limit_in_bytes"));
      std::uint64_t bytes = 0;
      if (file >> bytes) least = std::min(least, bytes);
      if (at.empty()) break;
    }
  }
  return least;
}

std::uint64_t DefaultMemoryBudget() {
  const long pages = sysconf(_SC_PHYS_PAGES);
  const long page_bytes = sysconf(_SC_PAGESIZE);
  std::ifstream own("/proc/self/cgroup");
  const std::uint64_t limit = CgroupLimitBytes("/sys/fs/cgroup", own);
  const auto machine = static_cast<std::uint64_t>(pages) * static_cast<std::uint64_t>(page_bytes);
  if (pages <= 0 || page_bytes <= 0) return std::uint64_t{4} << 30;
  return std::min(machine, limit - std::min(limit, kProcessBytes)) / 4 * 3;
}

}  // namespace palpate
