// How much memory volumes may take: those who are about to hold some say so first,
// and are refused in advance where it would be too much.
//
// It counts the volume under the stylus with its edits, a new one while it is loaded, the frames
// of a series, what a filter makes, and uploads. The steps that can be undone, recordings and
// streams have limits of their own, and so has the importer, a process of its own.
//
// Threads: any, at once. Ownership: a claim keeps its budget alive, and gives its
// bytes back when it is destroyed.
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace palpate {

class MemoryBudget;

class MemoryClaim {
 public:
  MemoryClaim() = default;  // of nothing
  MemoryClaim(MemoryClaim&& other) noexcept;
  MemoryClaim& operator=(MemoryClaim&& other) noexcept;
  ~MemoryClaim();

  // Throws Error (kTooLarge) where it would grow beyond the budget; it stays as it
  // was then. Not of an empty claim.
  void Resize(std::uint64_t bytes);
  // Another holder from here on.
  void Rename(const std::string& holder);
  std::uint64_t bytes() const { return bytes_; }

 private:
  friend MemoryBudget;
  std::shared_ptr<MemoryBudget> budget_;
  std::string holder_;
  std::uint64_t bytes_ = 0;
};

class MemoryBudget : public std::enable_shared_from_this<MemoryBudget> {
 public:
  static constexpr char kKey[] = "volume.memory_budget_mib";
  static constexpr std::uint64_t kUnlimited = std::numeric_limits<std::uint64_t>::max();

  static std::shared_ptr<MemoryBudget> Make(std::uint64_t bytes = kUnlimited) {
    return std::shared_ptr<MemoryBudget>(new MemoryBudget(bytes));
  }

  // `holder` such as "the volume", as messages name it.
  // Throws Error (kTooLarge) that says what is needed, left and held.
  MemoryClaim Claim(const std::string& holder, std::uint64_t bytes);

  std::uint64_t held_bytes() const;

 private:
  friend MemoryClaim;
  explicit MemoryBudget(std::uint64_t bytes) : bytes_(bytes) {}
  void Change(const std::string& holder, std::uint64_t from, std::uint64_t to);
  // Modulo 2^64.
  void AddLocked(const std::string& holder, std::uint64_t difference);
  std::string Refusal(const std::string& holder, std::uint64_t needed, std::uint64_t held) const;

  const std::uint64_t bytes_;
  mutable std::mutex mutex_;
  std::map<std::string, std::uint64_t> held_;  // by holder, none 0
};

// Three quarters of the machine's memory.
std::uint64_t DefaultMemoryBudget();

}  // namespace palpate
