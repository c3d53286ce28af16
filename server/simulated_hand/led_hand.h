// The simulated hand while a person leads it: who does, and where they want it.
//
// One leader at a time. A leader takes the hand, moves it, and gives it back. The servo thread sees
// the newest target only.
//
// Frame D, mm. Threads: Newest on the servo thread; everything else on any ordinary thread.
// Real-time: Newest is wait-free. Ownership: outlives the device that follows it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "common/geometry/geometry.h"
#include "server/realtime/latest_value.h"
#include "server/simulated_hand/stylus_script.h"

namespace palpate {

struct LedTarget {
  bool is_led = false;  // false: nobody leads the hand, and the rest means nothing
  double x_mm = 0.0;    // finite
  double y_mm = 0.0;
  double z_mm = 0.0;
  std::uint32_t buttons = 0;  // bit n: button n pressed
  // How the stylus is to be turned: a unit quaternion. `is_turned` is false: as it turns by itself.
  bool is_turned = false;
  std::array<double, 4> wxyz{1.0, 0.0, 0.0, 0.0};
};

class LedHand {
 public:
  // A leader's number, never 0.
  using Lead = std::uint64_t;

  // `who`: for people, such as "token ada at ipv4:192.0.2.7:51544". Throws Error (kConflict) that
  // names who leads the hand already. The hand moves with the first MoveTo.
  Lead Take(const std::string& who);
  // Ignored after GiveBack. Throws Error (kInvalidArgument) if the target is not finite, or the
  // orientation no unit quaternion but for rounding. No orientation: as the stylus turns by itself.
  void MoveTo(Lead lead, const Vec3& p_DTarget_mm, std::uint32_t buttons,
              const std::optional<Eigen::Quaterniond>& R_DS = {});
  // May be called again.
  void GiveBack(Lead lead);

  // Who leads the hand; empty: nobody.
  std::string led_by() const;

  const LedTarget& Newest() noexcept { return target_.Read(); }

 private:
  mutable std::mutex mutex_;  // guards the next three, and is the target's one writer
  Lead newest_ = 0;
  bool is_taken_ = false;
  std::string who_;
  LatestValue<LedTarget> target_;
};

inline constexpr double kLedMmPerS = 400.0;
inline constexpr double kLedRadPerS = 4.0;

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
