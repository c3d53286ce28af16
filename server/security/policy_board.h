// Holds the policy in force. Readers never wait, so that the emergency stop can ask it.
//
// gcc 12's atomic<shared_ptr> takes a lock. Here a reader counts itself and then loads a raw
// pointer. A replaced policy is freed when nobody reads: whoever counts itself later finds the new
// one.
//
// Threads: Read on any; Replace on one at a time.
#pragma once

#include <atomic>
#include <memory>
#include <utility>
#include <vector>

#include "server/security/policy.h"

namespace palpate {

class PolicyBoard {
 public:
  // The policy stays until this object ends.
  class Reading {
   public:
    explicit Reading(const PolicyBoard& board) : board_(board) {
      board.readers_.fetch_add(1);
      policy_ = board.newest_.load();
    }
    ~Reading() { board_.readers_.fetch_sub(1); }
    Reading(const Reading&) = delete;
    Reading& operator=(const Reading&) = delete;

    const Policy* operator->() const { return policy_; }
    // No other policy has come since.
    bool IsInForce() const { return board_.newest_.load() == policy_; }

   private:
    const PolicyBoard& board_;
    const Policy* policy_ = nullptr;
  };

  void Replace(std::shared_ptr<const Policy> policy) {
    newest_.store(policy.get());
    kept_.push_back(std::move(policy));
    // Beside a flood of calls it may take some replacements until nobody reads.
    if (readers_.load() == 0) kept_.erase(kept_.begin(), kept_.end() - 1);
  }

 private:
  std::vector<std::shared_ptr<const Policy>> kept_{std::make_shared<Policy>()};  // the newest last
  std::atomic<const Policy*> newest_{kept_.front().get()};
  mutable std::atomic<int> readers_{0};
};

}  // namespace palpate
