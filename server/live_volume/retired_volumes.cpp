#include "server/live_volume/retired_volumes.h"

#include <pthread.h>

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <utility>

#include "server/realtime/process_heap.h"
#include "server/volume/snapshot/brick_memory.h"

namespace palpate {
namespace {

// The time between two checks while a volume waits for its last holder, and while a caller waits
// for that.
constexpr std::chrono::milliseconds kPeriod{10};
constexpr std::chrono::milliseconds kUrgentPeriod{2};
// After this number of urgent checks without success, waiting callers stop waiting.
constexpr int kMostVainLooks = 50;

// Less memory goes back by itself.
constexpr std::uint64_t kWorthReturning = std::uint64_t{4} << 20;

}  // namespace

RetiredVolumes::RetiredVolumes(std::function<void()> collect)
    : collect_(std::move(collect)), thread_([this] { Run(); }) {}

RetiredVolumes::~RetiredVolumes() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void RetiredVolumes::Add(std::shared_ptr<const void> retired) {
  if (!retired) return;
  const std::lock_guard lock(mutex_);
  retired_.push_back(std::move(retired));
  if (retired_.size() == 1) wake_.notify_all();
}

void RetiredVolumes::WaitForFreed(std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  ++waiting_;
  vain_looks_ = 0;
  wake_.notify_all();
  looked_.wait_for(lock, patience, [this] {
    return (retired_.empty() && !is_looking_) || vain_looks_ >= kMostVainLooks;
  });
  --waiting_;
}

void RetiredVolumes::Run() {
  pthread_setname_np(pthread_self(), "palpate-free");
  // Freed bricks count until their memory is back: otherwise a new volume would come beside them.
  BrickWork work(BrickWork::Freed::kStillIn);
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stop_ || !retired_.empty(); });
    if (stop_) return;
    Holders taken = std::exchange(retired_, {});
    const std::size_t held = taken.size();
    is_looking_ = true;
    lock.unlock();
    Holders left = Look(std::move(taken));
    if (work.kept_bytes() >= kWorthReturning) ReturnFreedMemory();
    work.LetGo();
    lock.lock();
    is_looking_ = false;
    vain_looks_ = waiting_ > 0 && left.size() == held ? vain_looks_ + 1 : 0;
    retired_.insert(retired_.end(), std::make_move_iterator(left.begin()),
                    std::make_move_iterator(left.end()));
    looked_.notify_all();
    if (retired_.empty()) continue;
    const bool urgent = waiting_ > 0;
    wake_.wait_for(lock, urgent ? kUrgentPeriod : kPeriod,
                   [&] { return stop_ || (waiting_ > 0) != urgent; });
  }
}

RetiredVolumes::Holders RetiredVolumes::Look(Holders retired) {
  collect_();
  // An object that was added twice (as a volume and as the one to revert to) gets one entry.
  std::sort(retired.begin(), retired.end());
  retired.erase(std::unique(retired.begin(), retired.end()), retired.end());
  // With one holder left, only this thread could make a second holder.
  std::erase_if(retired, [](const auto& held) { return held.use_count() == 1; });
  return retired;
}

}  // namespace palpate
