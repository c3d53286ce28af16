// Waiting for what another thread or process does.
#pragma once

#include <chrono>
#include <thread>

namespace palpate::test {

// False where it does not hold within a time that no working machine takes.
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
