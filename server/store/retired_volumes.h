// Volumes that nobody shows any more, on the thread that frees them.
//
// To free a volume of a gigabyte takes half a second, and to give its memory back to the system as
// long again. So whoever replaces a volume hands it over here. It stays until nobody else holds it:
// not the servo, a stream, a recording or a call, none of which then ever frees it.
//
// Threads: any ordinary thread; a thread of its own frees. Nobody waits for it but WaitForFreed.
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
  // `collect`: lets go of what the servo does not use any more; before each look.
  explicit RetiredVolumes(std::function<void()> collect);
  // Lets go of everything.
  ~RetiredVolumes();
  RetiredVolumes(const RetiredVolumes&) = delete;
  RetiredVolumes& operator=(const RetiredVolumes&) = delete;

  // A volume, or what holds bricks of one. Null is nothing.
  void Add(std::shared_ptr<const void> retired);

  // The caller has freed bricks of so many bytes, or anything else that is large. Soon that is
  // given back to the system; until then these bytes count as live.
  void NoteFreed(std::uint64_t brick_bytes);

  // Until all that was added is freed and given back; not where others hold on to it, after a tenth
  // of a second in vain, and at most that long.
  void WaitForFreed(std::chrono::milliseconds patience);

 private:
  using Holders = std::vector<std::shared_ptr<const void>>;

  void Run();
  void WaitForWork(std::unique_lock<std::mutex>& lock);
  // Without the lock: what is left.
  Holders Look(Holders retired);
  // True when all that was freed is given back, or not worth it.
  bool GiveBack(std::uint64_t freed_bytes, bool wanted, bool urgent);

  using Clock = std::chrono::steady_clock;

  const std::function<void()> collect_;
  // The thread's own.
  std::uint64_t most_bytes_ = 0;  // in bricks, since memory was given back
  Clock::time_point given_back_at_{};

  std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  std::condition_variable looked_;
  Holders retired_;
  bool is_done_ = true;  // all that was taken out of retired_ is freed and given back
  int waiting_ = 0;
  int vain_looks_ = 0;  // after each other, while somebody waits
  bool give_back_ = false;
  std::uint64_t freed_bytes_ = 0;  // by others; counted as live
  bool stop_ = false;

  std::thread thread_;
};

// What the thread makes of bricks meanwhile. What it frees of that, where it fails for one, is
// given back to the system afterwards.
class TidyBrickWork : public BrickWork {
 public:
  explicit TidyBrickWork(RetiredVolumes& retired) : retired_(retired) {}
  ~TidyBrickWork() { retired_.NoteFreed(most_bytes() - made_bytes()); }

 private:
  RetiredVolumes& retired_;
};

}  // namespace palpate
