// Hands the newest immutable value from non-real-time publishers to one real-time reader, and frees
// the older values. A follower may come behind, for what the reader made of each value.
//
// Threads: Acquire on the one reader; Follow on the one follower; everything else on any number of
// non-real-time threads.
// Real-time: Acquire is wait-free (one load, one store), without allocation or system calls. The
// reader never frees anything.
// Ownership: the handoff owns a published value until the reader has moved on. A pointer from
// Acquire is valid on the reader's thread until its next Acquire, or until the reader has stopped.
// The follower shares what it got.
//
// Why it is safe. Value and sequence number are in one node, so the reader announces the number of
// exactly the node that it loaded. The one atomic pointer only ever gets newer values. The reader
// reads one atomic variable and therefore never goes backwards (coherence). After announcing n, the
// reader can no longer load a node older than n.
// The reader's last use of an older node comes before its announcement of n, which is a release. A
// publisher that reads n with acquire therefore frees the older nodes after that use. Between the
// reader's load of node n and its announcement of n, the previous announcement stands. It keeps
// more nodes, never fewer.
#pragma once

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <utility>

namespace palpate {

template <class T>
class SnapshotHandoff {
 public:
  SnapshotHandoff() = default;
  // The reader must have stopped.
  ~SnapshotHandoff() = default;
  SnapshotHandoff(const SnapshotHandoff&) = delete;
  SnapshotHandoff& operator=(const SnapshotHandoff&) = delete;

  // Makes `value` (not null) the newest, frees values that the reader no longer uses, and returns
  // the sequence number of `value`: 1, 2, 3 ...
  std::uint64_t Publish(std::unique_ptr<const T> value) {
    assert(value != nullptr);
    std::uint64_t sequence = 0;
    {
      const std::lock_guard lock(publishers_);
      sequence = ++sequence_;
      nodes_.push_back(std::make_unique<const Node>(Node{std::move(value), sequence}));
      newest_.store(nodes_.back().get(), std::memory_order_release);
    }
    Collect();
    return sequence;
  }

  // For the reader, once a tick. Returns the newest value; null before the first Publish.
  const T* Acquire() noexcept {
    const Node* node = newest_.load(std::memory_order_acquire);
    if (node == nullptr) return nullptr;
    announced_.store(node->sequence, std::memory_order_release);
    return node->value.get();
  }

  // For the follower. Between StartFollowing and StopFollowing, values are kept until Follow
  // returned, or FollowedUpTo named, a newer one. Follow returns the oldest value for which
  // is_wanted(value), if it is kept.
  template <class Predicate>
  std::shared_ptr<const T> Follow(Predicate is_wanted) {
    const std::lock_guard lock(publishers_);
    for (const auto& node : nodes_) {
      if (!is_wanted(*node->value)) continue;
      if (followed_ != kNotFollowed) followed_ = node->sequence;
      return node->value;
    }
    return nullptr;
  }
  // For a follower that waits for what the reader made: ask for reached() before looking, and if
  // nothing has come, tell it back.
  std::uint64_t reached() {
    const std::lock_guard lock(publishers_);
    return reader_stopped_ ? sequence_ : announced();
  }
  void FollowedUpTo(std::uint64_t sequence) {
    const std::lock_guard lock(publishers_);
    followed_ = std::max(followed_, sequence);
  }
  void StartFollowing() { SetFollowed(0); }
  void StopFollowing() { SetFollowed(kNotFollowed); }

  // The sequence number of the value that the reader acquired last. 0: none yet.
  std::uint64_t announced() const noexcept { return announced_.load(std::memory_order_acquire); }

  // Frees all values older than the announced one and the follower's.
  void Collect() {
    // Declared before the lock, so freed after its release: freeing a big value takes time, and
    // other publishers need not wait.
    std::deque<std::unique_ptr<const Node>> retired;
    const std::lock_guard lock(publishers_);
    const std::uint64_t oldest_in_use =
        std::min(reader_stopped_ ? sequence_ : announced(), followed_);
    while (!nodes_.empty() && nodes_.front()->sequence < oldest_in_use) {
      retired.push_back(std::move(nodes_.front()));
      nodes_.pop_front();
    }
  }

  // Call it when the reader's thread has been joined: the reader acquires no more and uses nothing
  // that it acquired. From now on, all values except the newest are freed when the follower has
  // moved on.
  void ReaderStopped() {
    {
      const std::lock_guard lock(publishers_);
      reader_stopped_ = true;
    }
    Collect();
  }

  // Call it before a reader acquires again after ReaderStopped, that is, before its thread starts.
  // The first reader does not need it.
  void ReaderRestarts() {
    const std::lock_guard lock(publishers_);
    reader_stopped_ = false;
  }

 private:
  struct Node {
    std::shared_ptr<const T> value;
    std::uint64_t sequence;
  };
  static_assert(std::atomic<const Node*>::is_always_lock_free);
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
  static constexpr std::size_t kCacheLineBytes = 64;

  static constexpr std::uint64_t kNotFollowed = ~std::uint64_t{0};

  void SetFollowed(std::uint64_t sequence) {
    const std::lock_guard lock(publishers_);
    followed_ = sequence;
  }

  std::mutex publishers_;  // guards the next four; the reader never takes it
  std::uint64_t sequence_ = 0;
  std::uint64_t followed_ = kNotFollowed;
  bool reader_stopped_ = false;
  std::deque<std::unique_ptr<const Node>> nodes_;  // oldest first, back() is the newest

  alignas(kCacheLineBytes) std::atomic<const Node*> newest_{nullptr};  // written by publishers
  alignas(kCacheLineBytes) std::atomic<std::uint64_t> announced_{0};   // written by the reader
};

}  // namespace palpate
