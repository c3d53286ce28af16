// Presses buttons of the stylus from time to time while another script moves the hand. It shows the
// tools of the stylus without hardware.
//
// Threads and real-time: as StylusScript; the constructor is not real-time.
#pragma once

#include <memory>

#include "server/simulated_hand/stylus_script.h"

namespace palpate {

// The buttons are held for the last kPressedS of every kPressPeriodS.
inline constexpr double kPressPeriodS = 3.0;
inline constexpr double kPressedS = 1.0;

class PressScript final : public StylusScript {
 public:
  // Bit n of `buttons`: button n. Throws Error without a script.
  PressScript(std::unique_ptr<StylusScript> script, std::uint32_t buttons);

  Target Next(const HandState& hand, const Wrench& felt_M, double dt_s) noexcept override;
  void ResumeAt(const HandState& hand) noexcept override { script_->ResumeAt(hand); }

 private:
  std::unique_ptr<StylusScript> script_;
  std::uint32_t buttons_;
  double time_s_ = 0.0;  // within the period
};

}  // namespace palpate
