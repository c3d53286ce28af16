// A value that palpated owns and the user is changing here. The control shows the user's value
// until palpated has it. Soon after the user has let go, the control shows palpated's value again.
//
// Threads: that of the frames.
#pragma once

#include <chrono>
#include <cmath>

namespace palpate::view {

class HeldValues {
 public:
  using Clock = std::chrono::steady_clock;
  // Longer than palpated takes to answer, and longer than between two facts about a series.
  static constexpr std::chrono::milliseconds kPatience{1500};

  // Returns the value that control `id` shows while palpated's value is `told`.
  double Shown(unsigned id, double told, Clock::time_point now = Clock::now()) {
    if (id != id_) return told;
    const bool agreed = std::abs(told - value_) <= 1e-9 * (1.0 + std::abs(value_));
    // Checks the time also while in_hand_: a control that is hidden meanwhile never reports that
    // the user let go.
    if ((agreed && !in_hand_) || now > until_) {
      id_ = 0;
      return told;
    }
    return value_;
  }

  // The value was changed from elsewhere, as by an undo.
  void LetGo() { id_ = 0; }

  // Call it after the control was drawn. `changed`: the user changed the value. `in_hand`: the user
  // still holds the control.
  void Update(unsigned id, double value, bool changed, bool in_hand,
              Clock::time_point now = Clock::now()) {
    if (changed) {
      id_ = id;
      value_ = value;
    }
    if (id != id_) return;
    in_hand_ = in_hand;
    if (changed || in_hand) until_ = now + kPatience;
  }

 private:
  unsigned id_ = 0;  // 0: nothing is held
  double value_ = 0.0;
  bool in_hand_ = false;
  Clock::time_point until_{};
};

}  // namespace palpate::view
