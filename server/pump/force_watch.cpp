#include "server/pump/force_watch.h"

#include <thread>

namespace palpate {

std::optional<ForceTick> ForceWatch::newest() const {
  const std::optional<LastTick> last = board_.newest();
  if (!last) return std::nullopt;
  return ForceTick{last->tick, last->forces, last->forces_since_tick, last->ended};
}

std::optional<ForceTick> ForceWatch::WaitForTick(std::uint64_t tick,
                                                 std::chrono::milliseconds timeout) const {
  const auto end = std::chrono::steady_clock::now() + timeout;
  while (true) {
    // Read the clock before the tick: a thread that lost its core then checks once more.
    const bool is_last = std::chrono::steady_clock::now() >= end;
    const std::optional<ForceTick> now = newest();
    if (now && (now->ended || now->tick >= tick)) return now;
    if (is_last) return std::nullopt;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

}  // namespace palpate
