// Waits for other threads or processes.
#pragma once

#include <chrono>
#include <thread>
#include <vector>

namespace palpate::test {

// Returns false if the condition does not hold within a time that is enough on every working
// machine.
template <typename Condition>
bool Eventually(const Condition& holds, std::chrono::seconds patience = std::chrono::seconds(60)) {
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (!holds()) {
    if (std::chrono::steady_clock::now() >= deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

// Calls work(0) to work(count - 1), each on a thread of its own, and waits for their ends.
template <typename Work>
void OnThreads(int count, const Work& work) {
  std::vector<std::thread> threads;
  for (int n = 0; n < count; ++n) threads.emplace_back([&work, n] { work(n); });
  for (std::thread& thread : threads) thread.join();
}

}  // namespace palpate::test
