// The newest immutable value, from non-real-time publishers to one real-time
// reader, and the memory of the older ones back.
//
// Threads: Acquire on the one reader; everything else on non-real-time threads,
// any number of them.
// Real-time: Acquire is wait-free (one load, one store), without allocation or
// system calls. The reader never frees anything.
// Ownership: the handoff owns what was published until the reader has moved on.
// A pointer from Acquire is valid on the reader's thread until its next Acquire,
// or until it has stopped.
//
// Why it is safe. Value and sequence number travel together in one node, so that
// the reader announces the number of exactly the node it loaded. There is one
// atomic pointer and its values only ever get newer, so the reader, which reads
// one atomic variable, never goes backwards (coherence). Thus once the reader has
// announced n it cannot load a node older than n any more. And its last use of an
// older node comes before that announcement, which is a release; a publisher
// that reads n with acquire frees the older nodes after that use. Between its
// load of node n and its announcement of n the older announcement stands, and
// that keeps more, never less.
#pragma once

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

  // Makes `value` (not null) the newest, frees what the reader has left, and
  // returns the value's sequence number: 1, 2, 3 ...
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

  // Reader, once a tick: the newest value; null before the first Publish.
  const T* Acquire() noexcept {
    const Node* node = newest_.load(std::memory_order_acquire);
    if (node == nullptr) return nullptr;
    announced_.store(node->sequence, std::memory_order_release);
    return node->value.get();
  }

  // Sequence number of the value that the reader acquired last; 0: none yet.
  std::uint64_t announced() const noexcept { return announced_.load(std::memory_order_acquire); }

  // Frees everything older than what the reader has announced.
  void Collect() {
    // Freed after the lock is released: a big value takes its time, and the
    // other publishers need not wait for it.
    std::deque<std::unique_ptr<const Node>> retired;
    const std::lock_guard lock(publishers_);
    const std::uint64_t oldest_in_use = reader_stopped_ ? sequence_ : announced();
    while (!nodes_.empty() && nodes_.front()->sequence < oldest_in_use) {
      retired.push_back(std::move(nodes_.front()));
      nodes_.pop_front();
    }
  }

  // The reader does not acquire any more and uses nothing that it acquired (its
  // thread has been joined): all but the newest is freed, now and from now on.
  void ReaderStopped() {
    {
      const std::lock_guard lock(publishers_);
      reader_stopped_ = true;
    }
    Collect();
  }

  // To be called before a reader acquires again after ReaderStopped (before its
  // thread is started). Not needed for the first one.
  void ReaderRestarts() {
    const std::lock_guard lock(publishers_);
    reader_stopped_ = false;
  }

 private:
  struct Node {
    std::unique_ptr<const T> value;
    std::uint64_t sequence;
  };
  static_assert(std::atomic<const Node*>::is_always_lock_free);
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
  static constexpr std::size_t kCacheLineBytes = 64;

  std::mutex publishers_;  // guards the next three; the reader never takes it
  std::uint64_t sequence_ = 0;
  bool reader_stopped_ = false;
  std::deque<std::unique_ptr<const Node>> nodes_;  // oldest first, back() is the newest

  alignas(kCacheLineBytes) std::atomic<const Node*> newest_{nullptr};  // written by publishers
  alignas(kCacheLineBytes) std::atomic<std::uint64_t> announced_{0};   // written by the reader
};

}  // namespace palpate
