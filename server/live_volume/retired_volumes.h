// Frees replaced volumes on a thread of its own.
//
// Freeing a volume of one gigabyte takes half a second. Code that replaces a volume therefore hands
// the old volume over here. The thread frees the volume when it is the only holder left, so that
// the servo, a stream, a recording or a call never has to free a volume.
//
// Threads: any ordinary thread. Only WaitForFreed waits for the freeing thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace palpate {

class RetiredVolumes {
 public:
  // `collect`: releases what the servo and the pump no longer use. The thread calls it before each
  // check.
  explicit RetiredVolumes(std::function<void()> collect);
  // Releases everything.
  ~RetiredVolumes();
  RetiredVolumes(const RetiredVolumes&) = delete;
  RetiredVolumes& operator=(const RetiredVolumes&) = delete;

  // Takes a volume, or an object that holds bricks of a volume. Ignores null.
  void Add(std::shared_ptr<const void> retired);

  // Waits until everything added is freed and returned to the system. Gives up after `patience`,
  // or after a tenth of a second in which others still hold all that is left.
  void WaitForFreed(std::chrono::milliseconds patience);

 private:
  using Holders = std::vector<std::shared_ptr<const void>>;

  void Run();
  // Frees what has no other holder and returns the rest. Call it without the lock.
  Holders Look(Holders retired);

  const std::function<void()> collect_;

  std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  std::condition_variable looked_;
  Holders retired_;
  bool is_looking_ = false;  // the thread has taken objects out of retired_
  int waiting_ = 0;
  int vain_looks_ = 0;  // checks in a row without success, while a caller waits
  bool stop_ = false;

  std::thread thread_;
};

}  // namespace palpate
