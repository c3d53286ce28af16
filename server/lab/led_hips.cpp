#include "server/lab/led_hips.h"

#include <memory>

#include "common/error/error.h"
#include "server/haptics/renderer.h"
#include "server/lab/replay.h"
#include "server/simulated_hand/fixed_scripts.h"
#include "server/simulated_hand/led_hand.h"
#include "server/simulated_hand/simulated_device.h"

namespace palpate::lab {
namespace {

constexpr double kAroundMm = 100.0;  // no stop is in the hand's way
constexpr double kAnySpeedMmPerS = 1.0;

DeviceDescription DeviceAround(const std::vector<Vec3>& targets_mm) {
  DeviceDescription spec = SimulatedDeviceSpec();
  spec.workspace_min_mm = spec.workspace_max_mm = targets_mm.front();
  for (const Vec3& target_mm : targets_mm) {
    spec.workspace_min_mm = spec.workspace_min_mm.cwiseMin(target_mm);
    spec.workspace_max_mm = spec.workspace_max_mm.cwiseMax(target_mm);
  }
  spec.workspace_min_mm -= Vec3::Constant(kAroundMm);
  spec.workspace_max_mm += Vec3::Constant(kAroundMm);
  return spec;
}

}  // namespace

std::vector<Vec3> HipsOfLedHand(const HapticSurface& surface, const HapticSettings& settings,
                                const std::vector<Vec3>& targets_mm) {
  if (targets_mm.empty()) {
    throw Error(ErrorKind::kInvalidArgument, "the trajectory is empty: it leads the hand nowhere");
  }
  const DeviceDescription spec = DeviceAround(targets_mm);
  LedHand led;
  const LedHand::Lead lead = led.Take("palpate-lab");
  auto stays = std::make_unique<PathScript>(std::vector<Vec3>{targets_mm.front()}, kAnySpeedMmPerS);
  SimulatedDevice device(std::make_unique<LedScript>(std::move(stays), led, spec.workspace_min_mm,
                                                     spec.workspace_max_mm),
                         spec);
  device.Start();
  const auto state = std::make_unique<RendererState>();
  std::vector<Vec3> hips_mm;
  for (const Vec3& target_mm : targets_mm) {
    led.MoveTo(lead, target_mm, 0);
    DeviceState now;
    device.Read(now);
    hips_mm.push_back(now.p_MHip_mm);
    const HapticOutput felt =
        StepRenderer(surface, settings, now.p_MHip_mm, kReplayPeriodS, *state);
    device.Write({{felt.force_D_n}}, kReplayPeriodS);
  }
  return hips_mm;
}

}  // namespace palpate::lab
