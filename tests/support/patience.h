// Waits for another thread or process.
#pragma once

#include <chrono>
#include <thread>

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

}  // namespace palpate::test
