// How much memory the volumes of the daemon may take: those who are about to take some claim it
// first, and are refused in advance where it would be too much.
//
// What is held is the bricks that live now, each counted once whoever holds it (brick_memory.h),
// and the claims. A claim is a promise: of bricks that are about to be made, and of memory that is
// no brick, such as uploads and the voxels that an importer hands over. It shrinks as the bricks
// are made, and ends when all are.
//
// Not counted are the importer, a process of its own, and what each program has beside volumes:
// threads, messages on their way to clients, the map of the steps to undo, the blocks that a
// recording writes. deploy/guides/live-data.md says how much that is.
//
// Threads: any, at once. Ownership: a claim keeps its budget alive, and gives its
// bytes back when it is destroyed.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
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

  // Of all bricks that live.
  using LiveBytes = std::uint64_t (*)() noexcept;
  // Waits, at most that long, for memory that is being freed.
  using WaitForFreed = std::function<void(std::chrono::milliseconds patience)>;

  // Without `live` only claims count.
  static std::shared_ptr<MemoryBudget> Make(std::uint64_t bytes = kUnlimited,
                                            LiveBytes live = nullptr) {
    return std::shared_ptr<MemoryBudget>(new MemoryBudget(bytes, live));
  }

  // `holder` such as "the new volume", as messages name it. Before it is refused, waits for what
  // is being freed. Throws Error (kTooLarge) that says what is needed, left and held.
  MemoryClaim Claim(const std::string& holder, std::uint64_t bytes,
                    std::chrono::milliseconds patience = kPatience);

  // What messages say of the bricks that live: that so many bytes are this part's. "other bricks"
  // are the rest.
  void SetPart(const std::string& part, std::uint64_t bytes);
  // Empty: nothing is being freed that is worth waiting for.
  void SetWait(WaitForFreed wait);

  std::uint64_t held_bytes() const;
  std::uint64_t left_bytes() const;  // 0 where more is held than there is

 private:
  friend MemoryClaim;
  static constexpr std::chrono::milliseconds kPatience{1000};

  MemoryBudget(std::uint64_t bytes, LiveBytes live) : bytes_(bytes), live_(live) {}
  void Change(const std::string& holder, std::uint64_t from, std::uint64_t to,
              std::chrono::milliseconds patience);
  bool TryChange(const std::string& holder, std::uint64_t from, std::uint64_t to);
  // Modulo 2^64.
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

// Three quarters of the machine's memory.
std::uint64_t DefaultMemoryBudget();

}  // namespace palpate
