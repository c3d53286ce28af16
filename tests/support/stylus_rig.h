// The whole loop around a scripted hand without a thread: simulated device, servo tick, session,
// editor and tools. One millisecond per tick. Every run has the same bits.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/device/simulated_device.h"
#include "server/servo/servo_tick.h"
#include "server/session/session.h"
#include "server/session/tools.h"

namespace palpate::testing {

// The hand's target and its buttons at a time.
using HandAt = std::function<StylusScript::Target(double time_s)>;

class HandScript final : public StylusScript {
 public:
  explicit HandScript(HandAt hand) : hand_(std::move(hand)) {}
  Target Next(const HandState&, const Vec3&, double dt_s) noexcept override {
    time_s_ += dt_s;
    return hand_(time_s_);
  }

 private:
  HandAt hand_;
  double time_s_ = 0.0;
};

class StylusRig {
 public:
  StylusRig(const std::string& source, const HapticSettings& settings, HandAt hand)
      : device(std::make_unique<HandScript>(std::move(hand))),
        outbox_(std::make_unique<TickOutbox>()),
        pump(*outbox_),
        session(device.spec(), inbox, pump, VolumeLoader{}),
        editor(session),
        tools(std::make_shared<StylusTools>(session, editor)),
        tick_(device) {
    session.SetInitial({.haptics = settings});
    session.Load(
        {.source = source}, [](std::string_view, double) {}, [] { return false; });
    device.Start();
  }

  // The tools run `lag_ticks` late.
  TickSample Tick() {
    const std::int64_t now_ns = 1'000'000 * ++ticks_;
    const TickSample sample = tick_.Run(*inbox.Acquire(), {now_ns, now_ns, 0});
    tools->OnSample(sample);
    if (lag_ticks == 0 || ticks_ % lag_ticks == 0) tools->Work();
    return sample;
  }
  std::vector<TickSample> Run(double seconds) {
    std::vector<TickSample> samples;
    for (int n = 0; n < static_cast<int>(seconds * 1e3 + 0.5); ++n) samples.push_back(Tick());
    return samples;
  }

  int lag_ticks = 0;
  SceneInbox inbox;
  SimulatedDevice device;

 private:
  std::unique_ptr<TickOutbox> outbox_;

 public:
  Pump pump;  // its thread does not run
  Session session;
  VolumeEditor editor;
  std::shared_ptr<StylusTools> tools;

 private:
  ServoTick tick_;
  std::int64_t ticks_ = 0;
};

inline Vec3 ToVec3(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }
inline Vec3 Force(const TickSample& sample) { return ToVec3(sample.force_n); }

}  // namespace palpate::testing
