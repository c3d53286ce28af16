// Frees replaced volumes on a thread of its own.
//
// Freeing a volume of one gigabyte takes half a second. Returning its memory to the system takes
// another half second. Code that replaces a volume therefore hands the old volume over here. The
// thread frees the volume when it is the only holder left, so that the servo, a stream, a
// recording or a call never has to free a volume.
//
// Threads: any ordinary thread. Only WaitForFreed waits for the freeing thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "server/volume/brick_memory.h"

namespace palpate {

class RetiredVolumes {
 public:
  // `collect`: releases what the servo no longer uses. The thread calls it before each check.
  explicit RetiredVolumes(std::function<void()> collect);
  // Releases everything.
  ~RetiredVolumes();
  RetiredVolumes(const RetiredVolumes&) = delete;
  RetiredVolumes& operator=(const RetiredVolumes&) = delete;

  // Takes a volume, or an object that holds bricks of a volume. Ignores null.
  void Add(std::shared_ptr<const void> retired);

  // Call it after freeing bricks of this many bytes, or other large memory. The thread returns the
  // memory to the system soon. Until then these bytes count as live.
  void NoteFreed(std::uint64_t brick_bytes);

  // Waits until everything added is freed and returned to the system. Gives up after `patience`,
  // or after a tenth of a second in which others still hold all that is left.
  void WaitForFreed(std::chrono::milliseconds patience);

 private:
  using Holders = std::vector<std::shared_ptr<const void>>;

  void Run();
  void WaitForWork(std::unique_lock<std::mutex>& lock);
  // Frees what has no other holder and returns the rest. Call it without the lock.
  Holders Look(Holders retired);
  // True if all freed memory is returned, or if too little is freed to return it.
  bool GiveBack(std::uint64_t freed_bytes, bool wanted, bool urgent);

  using Clock = std::chrono::steady_clock;

  const std::function<void()> collect_;
  // Used by the thread only.
  std::uint64_t most_bytes_ = 0;  // most bytes in bricks since memory was last returned
  Clock::time_point given_back_at_{};

  std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  std::condition_variable looked_;
  Holders retired_;
  bool is_done_ = true;  // all objects taken out of retired_ are freed and returned
  int waiting_ = 0;
  int vain_looks_ = 0;  // checks in a row without success, while a caller waits
  bool give_back_ = false;
  std::uint64_t freed_bytes_ = 0;  // freed elsewhere; counted as live
  bool stop_ = false;

  std::thread thread_;
};

// Counts the bricks that the constructing thread makes while this object lives. The destructor
// reports bricks that were freed again meanwhile (after a failure, say) to NoteFreed.
class TidyBrickWork : public BrickWork {
 public:
  explicit TidyBrickWork(RetiredVolumes& retired) : retired_(retired) {}
  ~TidyBrickWork() { retired_.NoteFreed(most_bytes() - made_bytes()); }

 private:
  RetiredVolumes& retired_;
};

}  // namespace palpate
