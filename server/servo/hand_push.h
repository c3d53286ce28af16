// A constant force for some ticks, to try the motors of a device. A push waits for nothing: if the
// forces do not act, it is dropped.
//
// Frame D, N. Threads: Push on one ordinary thread at a time; Next on the servo thread. Real-time:
// wait-free.
#pragma once

#include <array>
#include <cstdint>

#include "server/device/haptic_device.h"
#include "server/realtime/latest_value.h"

namespace palpate {

class HandPush {
 public:
  // The newest push replaces the one before; 0 ticks end it.
  void Push(const Vec3& force_D_n, int ticks) noexcept {
    asked_.Write({++number_, {force_D_n.x(), force_D_n.y(), force_D_n.z()}, ticks});
  }

  // The force of this tick; kNowhere: none. `forces_act`: false ends a push.
  Vec3 Next(bool forces_act) noexcept {
    const Asked& newest = asked_.Read();
    if (newest.number != taken_) {
      taken_ = newest.number;
      ticks_left_ = newest.ticks;
    }
    if (!forces_act) ticks_left_ = 0;
    if (ticks_left_ == 0) return kNowhere;
    --ticks_left_;
    return Vec3(newest.force_n.data());
  }

 private:
  struct Asked {
    std::uint64_t number = 0;  // counts from 1
    std::array<double, 3> force_n{};
    int ticks = 0;
  };

  std::uint64_t number_ = 0;  // of the thread that pushes
  LatestValue<Asked> asked_;
  // The servo thread's.
  std::uint64_t taken_ = 0;
  int ticks_left_ = 0;
};

}  // namespace palpate
