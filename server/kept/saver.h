// A thread that saves what has changed, for callers that wait until it has.
//
// Threads: any. Errors: none; what `save` throws ends the program, so it must not.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

namespace palpate {

class Saver {
 public:
  // Saves what has changed, if anything has, and returns why it could not; empty: all is on the
  // disk. `at_once`: a caller waits for it. Called on the thread, one call at a time.
  using Save = std::function<std::string(bool at_once)>;

  // How long Await waits: a caller may be a slider that moves.
  static constexpr std::chrono::milliseconds kPatience{1000};

  // `name`: of the thread, at most 15 bytes. Saves every `period`, and when somebody awaits it.
  Saver(std::string name, std::chrono::milliseconds period, Save save);
  ~Saver() { Stop(); }
  Saver(const Saver&) = delete;
  Saver& operator=(const Saver&) = delete;

  // Saves what there is now. Returns why it is not on the disk; empty: it is.
  std::string Await();
  // The result of the last save, or that the present one takes longer than kPatience.
  std::string failure() const;
  // Joins the thread, after one more save if none has been yet.
  void Stop() noexcept;

 private:
  void Run(const std::string& name);
  bool IsSlow() const;  // under the lock

  const std::chrono::milliseconds period_;
  const Save save_;
  mutable std::mutex mutex_;  // guards what follows; not held while it saves
  std::condition_variable wake_, saved_;
  std::uint64_t begun_ = 0, ended_ = 0;  // saves
  std::chrono::steady_clock::time_point began_{};
  bool is_wanted_ = false;  // by a caller, and has not begun
  bool was_slow_ = false;   // a caller was told so, and no save has ended since
  std::string failure_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace palpate
