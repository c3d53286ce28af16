#include "server/kept/saver.h"

#include <pthread.h>

#include <utility>

namespace palpate {
namespace {

constexpr const char* kSlow = "the disk takes longer than a second";

}  // namespace

Saver::Saver(std::string name, std::chrono::milliseconds period, Save save)
    : period_(period), save_(std::move(save)) {
  thread_ = std::thread([this, name = std::move(name)] { Run(name); });
}

std::string Saver::Await() {
  std::unique_lock lock(mutex_);
  // On a disk that stands still, callers would wait one after the other.
  if (IsSlow()) return kSlow;
  // What a save that has begun takes along may be older than the caller's change.
  const std::uint64_t own = begun_ + 1;
  is_wanted_ = true;
  wake_.notify_all();
  const bool is_saved =
      saved_.wait_for(lock, kPatience, [&] { return ended_ >= own || (stop_ && begun_ < own); });
  if (is_saved && ended_ >= own) return failure_;
  if (is_saved) return "palpated is ending";
  was_slow_ = true;
  return kSlow;
}

std::string Saver::failure() const {
  const std::lock_guard lock(mutex_);
  return IsSlow() ? kSlow : failure_;
}

bool Saver::IsSlow() const {
  const bool is_saving = begun_ > ended_;
  return was_slow_ || (is_saving && std::chrono::steady_clock::now() - began_ > kPatience);
}

void Saver::Stop() noexcept {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
  saved_.notify_all();
}

void Saver::Run(const std::string& name) {
  pthread_setname_np(pthread_self(), name.c_str());
  std::unique_lock lock(mutex_);
  while (true) {
    const bool at_once = std::exchange(is_wanted_, false);
    ++begun_;
    began_ = std::chrono::steady_clock::now();
    lock.unlock();
    std::string failure = save_(at_once);
    lock.lock();
    failure_ = std::move(failure);
    ended_ = begun_;
    was_slow_ = false;
    saved_.notify_all();
    wake_.wait_for(lock, period_, [this] { return stop_ || is_wanted_; });
    if (stop_) return;
  }
}

}  // namespace palpate
