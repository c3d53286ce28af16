#include "server/services/fact_board.h"

#include <pthread.h>

#include <algorithm>
#include <exception>
#include <utility>

#include "server/log/log.h"

namespace palpate {

FactBoard::FactBoard(const std::vector<Source>& sources) {
  for (const Source& source : sources) facts_.push_back({.source = source});
  thread_ = std::thread([this] { Run(); });
}

void FactBoard::Add(std::weak_ptr<FactFollower> follower) {
  {
    const std::lock_guard lock(mutex_);
    if (!stopped_) {
      // While nobody followed, nobody looked.
      if (followers_.empty()) {
        for (Fact& fact : facts_) fact.looked = {};
      }
      followers_.push_back(std::move(follower));
      has_new_follower_ = true;
      wake_.notify_one();
      return;
    }
  }
  if (const auto late = follower.lock()) late->End();
}

bool FactBoard::Take(Told& told, v1::Facts& facts) const {
  std::vector<std::shared_ptr<const v1::Facts>> newer;
  {
    const std::lock_guard lock(mutex_);
    told.resize(facts_.size());
    for (std::size_t n = 0; n < facts_.size(); ++n) {
      if (std::exchange(told[n], facts_[n].number) == facts_[n].number) continue;
      newer.push_back(facts_[n].newest);
    }
  }
  bool is_newer = false;
  for (const auto& fact : newer) {
    facts.MergeFrom(*fact);
    is_newer = true;
  }
  return is_newer;
}

void FactBoard::MayHaveChanged(std::string_view change) {
  const std::lock_guard lock(mutex_);
  for (Fact& fact : facts_) {
    const auto& after = fact.source.after;
    if (std::find(after.begin(), after.end(), change) != after.end()) fact.looks = 2;
  }
  wake_.notify_one();
}

void FactBoard::Stop() noexcept {
  std::vector<std::weak_ptr<FactFollower>> followers;
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
    followers.swap(followers_);
  }
  wake_.notify_one();
  for (const auto& weak : followers) {
    if (const auto follower = weak.lock()) follower->End();
  }
  if (thread_.joinable()) thread_.join();
}

void FactBoard::Run() {
  pthread_setname_np(pthread_self(), "palpate-facts");
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stopped_ || !followers_.empty(); });
    if (stopped_) return;
    bool is_news = std::exchange(has_new_follower_, false);
    for (Fact& fact : facts_) {
      if (fact.due() <= Clock::now()) is_news = Look(fact, lock) || is_news;
    }
    if (is_news) {
      TellAll(lock);
      continue;
    }
    auto next = Clock::time_point::max();
    for (const Fact& fact : facts_) next = std::min(next, fact.due());
    // Else the lock was never free since they were set: nobody wakes this again.
    if (!stopped_ && !has_new_follower_) wake_.wait_until(lock, next);
  }
}

bool FactBoard::Look(Fact& fact, std::unique_lock<std::mutex>& lock) {
  fact.looked = Clock::now();
  fact.looks = std::max(0, fact.looks - 1);
  lock.unlock();
  const auto seen = std::make_shared<v1::Facts>();
  try {
    fact.source.look(*seen);
    fact.problem.clear();
  } catch (const std::exception& error) {
    seen->Clear();
    if (std::exchange(fact.problem, error.what()) != error.what()) {
      LogWarning("followers are not told what is new: {}", error.what());
    }
  }
  std::string bytes = seen->SerializeAsString();
  lock.lock();
  if (bytes.empty() || bytes == fact.bytes) return false;
  fact.newest = seen;
  fact.bytes = std::move(bytes);
  ++fact.number;
  return true;
}

void FactBoard::TellAll(std::unique_lock<std::mutex>& lock) {
  std::erase_if(followers_, [](const auto& weak) { return weak.expired(); });
  const auto followers = followers_;
  lock.unlock();
  for (const auto& weak : followers) {
    if (const auto follower = weak.lock()) follower->OnFacts();
  }
  lock.lock();
}

}  // namespace palpate
