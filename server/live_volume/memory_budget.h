// Limits how much memory the daemon's volumes may take. Code that is about to take memory claims it
// first. A claim beyond the budget is refused in advance.
//
// The budget counts the live bricks, each once, however many holders it has (brick_memory.h), and
// the claims. A claim promises memory for bricks that are about to be made, and for other data such
// as uploads and the voxels of an importer. The claim shrinks as the bricks are made, and ends when
// all of them are made.
//
// The budget does not count the importer, which is another process. It also does not count what the
// daemon needs besides volumes: threads, messages on their way to clients, the map of the undo
// steps, the blocks of a recording. deploy/guides/live-data.md says how much that is.
//
// Threads: any, at once. Ownership: a claim keeps its budget alive, and gives its bytes back when
// it is destroyed.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <iosfwd>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace palpate {

class MemoryBudget;

class MemoryClaim {
 public:
  MemoryClaim() = default;  // claims nothing
  MemoryClaim(MemoryClaim&& other) noexcept;
  MemoryClaim& operator=(MemoryClaim&& other) noexcept;
  ~MemoryClaim();

  // Throws Error (kTooLarge) if the claim would grow beyond the budget; the claim is unchanged
  // then. Not for an empty claim.
  void Resize(std::uint64_t bytes);
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

  // The bytes of all live bricks.
  using LiveBytes = std::uint64_t (*)() noexcept;
  // Waits for memory that is being freed, at most `patience`.
  using WaitForFreed = std::function<void(std::chrono::milliseconds patience)>;

  // Without `live`, only claims count.
  static std::shared_ptr<MemoryBudget> Make(std::uint64_t bytes = kUnlimited,
                                            LiveBytes live = nullptr) {
    return std::shared_ptr<MemoryBudget>(new MemoryBudget(bytes, live));
  }

  // `holder` names the claim in messages, for example "the new volume". If there is too little
  // room, waits for memory that is being freed. Throws Error (kTooLarge) that says what is needed,
  // left and held.
  MemoryClaim Claim(const std::string& holder, std::uint64_t bytes);

  // Names a part of the live bricks in messages, with its bytes. The rest is called "other bricks".
  void SetPart(const std::string& part, std::uint64_t bytes);
  // Empty: no wait.
  void SetWait(WaitForFreed wait);

  std::uint64_t held_bytes() const;
  std::uint64_t left_bytes() const;  // 0 if more is held than the budget allows

 private:
  friend MemoryClaim;
  static constexpr std::chrono::milliseconds kPatience{1000};

  MemoryBudget(std::uint64_t bytes, LiveBytes live) : bytes_(bytes), live_(live) {}
  void Change(const std::string& holder, std::uint64_t from, std::uint64_t to);
  bool TryChange(const std::string& holder, std::uint64_t from, std::uint64_t to);
  // Adds modulo 2^64.
  void AddLocked(const std::string& holder, std::uint64_t difference);
  std::uint64_t HeldLocked() const;
  std::string Refusal(const std::string& holder, std::uint64_t from, std::uint64_t to) const;

  const std::uint64_t bytes_;
  const LiveBytes live_;
  mutable std::mutex mutex_;                    // guards what follows
  std::map<std::string, std::uint64_t> held_;   // claims by holder, none 0
  std::map<std::string, std::uint64_t> parts_;  // of the live bytes, none 0
  WaitForFreed wait_;
};

// The least limit of memory of a process's control groups, v1 or v2; the greatest number if there
// is none. cgroups: such as /sys/fs/cgroup. own: as /proc/self/cgroup.
std::uint64_t CgroupLimitBytes(const std::filesystem::path& cgroups, std::istream& own);

// Three quarters of the machine's memory, or of the least limit of this process's control groups.
std::uint64_t DefaultMemoryBudget();

}  // namespace palpate
