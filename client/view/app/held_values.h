// A value that the user is changing here and that palpated owns: the control shows the
// user's until palpated has it, and palpated's again soon after the hand has let go.
//
// Threads: that of the frames.
#pragma once

#include <chrono>
#include <cmath>

namespace palpate::view {

class HeldValues {
 public:
  // What control `id` shows while palpated has `told`.
  double Shown(unsigned id, double told) {
    if (id != id_) return told;
    const bool agreed = std::abs(told - value_) <= 1e-9 * (1.0 + std::abs(value_));
    // Also in the hand: a control that is hidden meanwhile says no more that it was let go.
    if ((agreed && !in_hand_) || Clock::now() > until_) {
      id_ = 0;
      return told;
    }
    return value_;
  }

  // After the control was drawn: whether it was changed, and is in the user's hand.
  void Update(unsigned id, double value, bool changed, bool in_hand) {
    if (changed) {
      id_ = id;
      value_ = value;
    }
    if (id != id_) return;
    in_hand_ = in_hand;
    if (changed || in_hand) until_ = Clock::now() + kPatience;
  }

 private:
  using Clock = std::chrono::steady_clock;
  // Longer than palpated takes to answer, and than a series is asked about.
  static constexpr std::chrono::milliseconds kPatience{1500};

  unsigned id_ = 0;  // nothing is held
  double value_ = 0.0;
  bool in_hand_ = false;
  Clock::time_point until_{};
};

}  // namespace palpate::view
