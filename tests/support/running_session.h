// A session under a running servo loop and pump, as in the daemon, without gRPC.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "server/servo/servo_loop.h"
#include "server/simulated_hand/fixed_scripts.h"
#include "tests/support/editable_session.h"
#include "tests/support/patience.h"

namespace palpate::testing {

class RunningSession : public EditableSession {
 public:
  explicit RunningSession(VolumeLoader loader = {},
                          std::unique_ptr<StylusScript> script = ThroughTheMiddle())
      : EditableSession(std::move(loader)),
        simulated_(std::move(script)),
        servo_(simulated_, inbox(), outbox(), Options(), SafetyLimits{}) {}
  ~RunningSession() { Stop(); }

  // Load first.
  void Start() {
    pump().Start();
    servo_.Start();
  }
  void Stop() {
    servo_.Stop();
    pump().Stop();
  }
  ServoLoop& servo() { return servo_; }
  HapticDevice& simulated() { return simulated_; }

  // Through what lies in the middle of the workspace, and back.
  static std::unique_ptr<StylusScript> ThroughTheMiddle() {
    return std::make_unique<PathScript>(std::vector<Vec3>{Vec3(-70, 2, 1), Vec3(70, 1, 2)}, 100.0);
  }
  void AwaitTicks(std::uint64_t ticks) {
    const std::uint64_t end = servo_.ticks() + ticks;
    EXPECT_TRUE(test::Eventually([&] { return servo_.ticks() >= end; }));
  }
  // Waits until nobody holds the volume, which was replaced.
  bool IsFreed(const std::weak_ptr<const VolumeSnapshot>& replaced) {
    return test::Eventually([&] {
      session().retired().WaitForFreed(std::chrono::seconds(60));
      return replaced.expired();
    });
  }

 private:
  static RealtimeOptions Options() {
    RealtimeOptions options;
    options.lock_memory = false;
    return options;
  }

  SimulatedDevice simulated_;
  ServoLoop servo_;
};

}  // namespace palpate::testing
