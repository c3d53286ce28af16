// The newest of each fact, for those who follow them (proto/palpate/v1/facts.proto).
//
// There is no queue. A follower keeps the number of what it was told last of each fact, and takes
// what has a greater one. One thread, "palpate-facts", looks at a fact when it may have changed,
// and once a second for what changes by itself. While nobody follows, it sleeps.
//
// Threads: any; nothing but the destructor and Stop waits. Ownership: holds followers by weak_ptr.
// Errors: none. A look that throws leaves its fact as it was told last, and the log says why.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "palpate/v1/facts.pb.h"

namespace palpate {

class FactFollower {
 public:
  virtual ~FactFollower() = default;
  // There may be something to take. Called on the board's thread; must not wait.
  virtual void OnFacts() = 0;
  // Called on the thread that calls Stop.
  virtual void End() = 0;
};

class FactBoard {
 public:
  static constexpr std::chrono::milliseconds kAnyway{1000};

  // How to look at one fact: puts it into the message, or leaves the message as it is if the fact
  // is not known yet. Called on the board's thread. `pause`: until it is looked at again, at least.
  // `after`: the changes that change it.
  struct Source {
    std::function<void(v1::Facts&)> look;
    std::chrono::milliseconds pause{};
    std::vector<std::string_view> after{};
  };
  // The numbers of what a follower was told last.
  using Told = std::vector<std::uint64_t>;

  explicit FactBoard(const std::vector<Source>& sources);
  ~FactBoard() { Stop(); }
  FactBoard(const FactBoard&) = delete;
  FactBoard& operator=(const FactBoard&) = delete;

  // From now on the follower is told; of all facts soon.
  void Add(std::weak_ptr<FactFollower> follower);
  // Puts what is newer than `told` into `facts`. Returns false if nothing is.
  bool Take(Told& told, v1::Facts& facts) const;
  // The facts after this change may be other ones now, or in a moment: who calls may be a step
  // ahead of what it tells of. So they are looked at, and once more after their pause.
  void MayHaveChanged(std::string_view change);

  // Ends the followers, and joins the thread. There is no restart.
  void Stop() noexcept;

 private:
  using Clock = std::chrono::steady_clock;
  struct Fact {
    Source source{};
    std::shared_ptr<const v1::Facts> newest{};
    std::string bytes{};       // of `newest`
    std::string problem{};     // why the last look threw; empty: it did not
    std::uint64_t number = 0;  // rises with each other one; 0: not known yet
    Clock::time_point looked{};
    int looks = 0;  // to come because of a change

    Clock::time_point due() const { return looked + (looks > 0 ? source.pause : kAnyway); }
  };

  void Run();
  // Looks at the fact without the lock. Returns true if it is another one.
  bool Look(Fact& fact, std::unique_lock<std::mutex>& lock);
  void TellAll(std::unique_lock<std::mutex>& lock);

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  std::vector<Fact> facts_;
  std::vector<std::weak_ptr<FactFollower>> followers_;
  bool has_new_follower_ = false;
  bool stopped_ = false;
  std::thread thread_;
};

}  // namespace palpate
