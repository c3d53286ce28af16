#include "server/session/memory_budget.h"

#include <unistd.h>

#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

// Rounded up: what is needed is never said to be less.
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

void MemoryClaim::Rename(const std::string& holder) {
  if (!budget_) return;
  const std::lock_guard lock(budget_->mutex_);
  if (holder == holder_) return;
  budget_->AddLocked(holder_, 0 - bytes_);
  budget_->AddLocked(holder, bytes_);
  holder_ = holder;
}

MemoryClaim MemoryBudget::Claim(const std::string& holder, std::uint64_t bytes) {
  Change(holder, 0, bytes);
  MemoryClaim claim;
  claim.budget_ = shared_from_this();
  claim.holder_ = holder;
  claim.bytes_ = bytes;
  return claim;
}

std::uint64_t MemoryBudget::held_bytes() const {
  const std::lock_guard lock(mutex_);
  std::uint64_t sum = 0;
  for (const auto& [holder, bytes] : held_) sum += bytes;
  return sum;
}

void MemoryBudget::Change(const std::string& holder, std::uint64_t from, std::uint64_t to) {
  const std::lock_guard lock(mutex_);
  if (to > from) {
    std::uint64_t others = 0;
    for (const auto& [name, bytes] : held_) others += bytes;
    others -= from;
    if (to > bytes_ || others > bytes_ - to) {
      throw Error(ErrorKind::kTooLarge, Refusal(holder, to, others));
    }
  }
  AddLocked(holder, to - from);
}

void MemoryBudget::AddLocked(const std::string& holder, std::uint64_t difference) {
  const auto entry = held_.try_emplace(holder, 0).first;
  entry->second += difference;
  if (entry->second == 0) held_.erase(entry);
}

std::string MemoryBudget::Refusal(const std::string& holder, std::uint64_t needed,
                                  std::uint64_t held) const {
  std::string list;
  for (const auto& [name, bytes] : held_) {
    list += (list.empty() ? " (" : ", ") + name + " " + Mib(bytes);
  }
  if (!list.empty()) list += ")";
  return holder + " needs " + Mib(needed) + "; of the memory budget of " + Mib(bytes_) + ", " +
         Mib(held) + " are held" + list +
         ": load something smaller first, crop the data, or raise " + kKey;
}

std::uint64_t DefaultMemoryBudget() {
  const long pages = sysconf(_SC_PHYS_PAGES);
  const long page_bytes = sysconf(_SC_PAGESIZE);
  if (pages <= 0 || page_bytes <= 0) return std::uint64_t{4} << 30;
  return static_cast<std::uint64_t>(pages) / 4 * 3 * static_cast<std::uint64_t>(page_bytes);
}

}  // namespace palpate
