// What Esc does: it closes what is open on top. Where nothing is open, it stops the forces. A
// second Esc within a second always stops them.
//
// Threads: that of the frames and of the window's events. Pure.
#pragma once

#include <chrono>
#include <optional>
#include <utility>

namespace palpate::view {

// What Esc can close, from the top.
enum class Open { kNothing, kPathForm, kConnect, kField, kPopup, kHelp, kQuestion, kDistance };

class EscapeRule {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kAgain{1};

  // Takes a press of Esc while `open` is on top. Returns true if it stops the forces. If no frame
  // has closed the last thing yet, it stops them: a slow frame must not hide a second press.
  bool Press(Open open, Clock::time_point now) {
    const bool is_second = pressed_at_ && now - *pressed_at_ <= kAgain;
    pressed_at_ = now;
    const bool stops = is_second || open == Open::kNothing || closing_ != Open::kNothing;
    closing_ = stops ? Open::kNothing : open;
    closes_ = !stops;
    return stops;
  }
  // For the next frame: what it is to close.
  Open TakeClosing() { return std::exchange(closing_, Open::kNothing); }
  // True for a second after something was closed: Esc again stops the forces.
  bool Warns(Clock::time_point now) const {
    return closes_ && pressed_at_ && now - *pressed_at_ <= kAgain;
  }

 private:
  std::optional<Clock::time_point> pressed_at_;
  Open closing_ = Open::kNothing;
  bool closes_ = false;  // the last press
};

}  // namespace palpate::view
