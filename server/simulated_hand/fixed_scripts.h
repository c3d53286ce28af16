// Scripts that ignore the force: a closed path, and presses of the stylus's buttons.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "server/simulated_hand/stylus_script.h"

namespace palpate {

// A script that follows a closed path of straight lines and ignores the force. For tests and
// demonstrations.
//
// Frame M, mm. Threads and real-time: as StylusScript; the constructor is not
// real-time.
class PathScript final : public StylusScript {
 public:
  // Starts at the first way point; from the last way point, returns to the first. Throws Error if
  // there is no way point, a number is not finite, or the speed is not above 0.
  PathScript(std::vector<Vec3> p_MWaypoints_mm, double speed_mm_s);

  Target Next(const HandState& hand, const Wrench& felt_M, double dt_s) noexcept override;
  // Goes on to the next way point, from there.
  void ResumeAt(const HandState& hand) noexcept override { target_mm_ = hand.p_MHip_mm; }

 private:
  std::vector<Vec3> waypoints_mm_;
  double speed_mm_s_;
  std::size_t next_ = 0;  // the next way point
  Vec3 target_mm_;
};

// The buttons are held for the last kPressedS of every kPressPeriodS.
inline constexpr double kPressPeriodS = 3.0;
inline constexpr double kPressedS = 1.0;

// Presses buttons of the stylus from time to time while another script moves the hand. It shows the
// tools of the stylus without hardware.
//
// Threads and real-time: as StylusScript; the constructor is not real-time.
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
