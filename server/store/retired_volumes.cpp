#include "server/store/retired_volumes.h"

#include <pthread.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "server/realtime/thread_setup.h"

namespace palpate {
namespace {

// The time between two checks: while a volume waits for its last holder, while a caller waits for
// that (urgent), and while there is nothing to free.
constexpr std::chrono::milliseconds kPeriod{10};
constexpr std::chrono::milliseconds kUrgentPeriod{2};
// After this number of urgent checks without success, waiting callers stop waiting.
constexpr int kMostVainLooks = 50;
constexpr std::chrono::milliseconds kIdlePeriod{1000};

// The least time between two returns of memory, unless a caller waits.
constexpr std::chrono::milliseconds kLeastPause{1000};

// Returning less memory is not worth the time.
constexpr std::uint64_t kWorthGivingBack = std::uint64_t{4} << 20;

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
  bool is_first = false;
  {
    const std::lock_guard lock(mutex_);
    is_first = retired_.empty();
    retired_.push_back(std::move(retired));
  }
  if (is_first) wake_.notify_all();
}

void RetiredVolumes::NoteFreed(std::uint64_t brick_bytes) {
  AddBrickBytes(brick_bytes);
  {
    const std::lock_guard lock(mutex_);
    freed_bytes_ += brick_bytes;
    give_back_ = true;
  }
  wake_.notify_all();
}

void RetiredVolumes::WaitForFreed(std::chrono::milliseconds patience) {
  const auto end = Clock::now() + patience;
  std::unique_lock lock(mutex_);
  ++waiting_;
  vain_looks_ = 0;
  wake_.notify_all();
  looked_.wait_until(lock, end, [this] {
    const bool is_over = retired_.empty() && is_done_ && !give_back_;
    return is_over || vain_looks_ >= kMostVainLooks;
  });
  --waiting_;
}

void RetiredVolumes::WaitForWork(std::unique_lock<std::mutex>& lock) {
  const bool has_work = !retired_.empty() || !is_done_;
  if (has_work && waiting_ > 0) {
    wake_.wait_for(lock, kUrgentPeriod, [this] { return stop_; });
  } else if (has_work) {
    wake_.wait_for(lock, kPeriod, [this] { return stop_ || waiting_ > 0; });
  } else {
    // Bricks may also be freed elsewhere.
    wake_.wait_for(lock, kIdlePeriod, [this] { return stop_ || give_back_ || !retired_.empty(); });
  }
}

void RetiredVolumes::Run() {
  pthread_setname_np(pthread_self(), "palpate-free");
  BrickWork work(BrickWork::Freed::kStillIn);
  std::uint64_t freed_bytes = 0;  // freed elsewhere
  bool give_back = false;
  std::unique_lock lock(mutex_);
  while (!stop_) {
    WaitForWork(lock);
    Holders taken = std::exchange(retired_, {});
    give_back |= std::exchange(give_back_, false);
    freed_bytes += std::exchange(freed_bytes_, 0);
    const bool urgent = waiting_ > 0;
    const std::size_t held = taken.size();
    is_done_ = false;
    lock.unlock();
    Holders left = Look(std::move(taken));
    const bool is_done = GiveBack(freed_bytes + work.kept_bytes(), give_back, urgent);
    if (is_done) {
      SubtractBrickBytes(std::exchange(freed_bytes, 0));
      work.LetGo();
      give_back = false;
    }
    lock.lock();
    is_done_ = is_done;
    vain_looks_ = urgent && is_done && left.size() == held ? vain_looks_ + 1 : 0;
    retired_.insert(retired_.end(), std::make_move_iterator(left.begin()),
                    std::make_move_iterator(left.end()));
    if (waiting_ > 0) looked_.notify_all();
  }
  SubtractBrickBytes(freed_bytes + freed_bytes_);
}

RetiredVolumes::Holders RetiredVolumes::Look(Holders retired) {
  if (retired.empty()) return retired;
  collect_();
  // An object that was added twice (as a volume and as the one to revert to) gets one entry.
  std::sort(retired.begin(), retired.end());
  retired.erase(std::unique(retired.begin(), retired.end()), retired.end());
  // With one holder left, only this thread could make a second holder.
  std::erase_if(retired, [](const auto& held) { return held.use_count() == 1; });
  return retired;
}

bool RetiredVolumes::GiveBack(std::uint64_t freed_bytes, bool wanted, bool urgent) {
  const std::uint64_t live = LiveBrickBytes();
  most_bytes_ = std::max(most_bytes_, live);
  const std::uint64_t in_use = live - std::min(live, freed_bytes);
  // New bricks take the place of freed ones. While voxels change all the time, there is little to
  // return.
  if (!wanted && in_use + kWorthGivingBack > most_bytes_) return true;
  if (!urgent && Clock::now() < given_back_at_ + kLeastPause) return false;
  ReturnFreedMemory();
  most_bytes_ = in_use;
  given_back_at_ = Clock::now();
  return true;
}

}  // namespace palpate
