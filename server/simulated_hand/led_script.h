// A script whose hand goes where a person leads it, and does as another script says while nobody
// does.
//
// Targets come at 60 to 250 Hz, unevenly, with gaps of up to a second. The hand goes to the newest
// one smoothly, at most kLedMmPerS fast, and lags a moving target by about 25 ms. Targets beyond
// the workspace count as the nearest place of it. The force that the hand feels deflects it: in
// contact it is at target + force / kHandSpringNPerMm. A led orientation is followed at most
// kLedRadPerS fast, with the same lag.
//
// Frame M, mm, N, s. Threads and real-time: as StylusScript; targets come by a wait-free exchange.
// The same inputs and targets at the same ticks give the same bits.
#pragma once

#include <array>
#include <cstddef>
#include <memory>

#include "server/simulated_hand/hand_follower.h"
#include "server/simulated_hand/led_hand.h"
#include "server/simulated_hand/stylus_script.h"

namespace palpate {

inline constexpr double kLedMmPerS = 400.0;
inline constexpr double kLedRadPerS = 4.0;

class LedScript final : public StylusScript {
 public:
  // Borrows the hand, of which it is the reader. Throws Error without a script.
  LedScript(std::unique_ptr<StylusScript> unled, LedHand& led, const Vec3& workspace_min_mm,
            const Vec3& workspace_max_mm);

  Target Next(const HandState& hand, const Wrench& felt_M, double dt_s) noexcept override;

 private:
  // The mean of the last targets, one for each millisecond.
  class Mean {
   public:
    void Begin(const Vec3& p_mm);
    Vec3 Add(const Vec3& p_mm);

   private:
    // The time between two targets of a screen at 60 Hz: its steps become straight lines.
    static constexpr std::size_t kSize = 16;
    std::array<Vec3, kSize> last_mm_;
    std::size_t oldest_ = 0;
  };

  void Begin(const HandState& hand, const Vec3& felt_force_M_n);
  void Follow(double dt_s);
  void Turn(const LedTarget& newest, double dt_s);

  std::unique_ptr<StylusScript> unled_;
  LedHand& led_;
  Vec3 workspace_min_mm_;
  Vec3 workspace_max_mm_;

  bool is_led_ = false;
  Vec3 p_MTarget_mm_ = Vec3::Zero();  // within the workspace
  Mean mean_;
  Vec3 p_MWay_mm_ = Vec3::Zero();  // on the way to the mean, no faster than the hand may be
  HandFollower hand_;
  bool is_turned_ = false;
  Eigen::Quaterniond R_MHeld_;    // of the stylus in this tick
  Eigen::Quaterniond R_MTarget_;  // on the way to the led one
};

}  // namespace palpate
