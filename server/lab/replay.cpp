#include "server/lab/replay.h"

#include <algorithm>
#include <chrono>
#include <memory>

#include "common/error/error.h"

namespace palpate::lab {
namespace {

bool AreSame(const HapticOutput& a, const HapticOutput& b) {
  return a.proxy.p_DH_mm == b.proxy.p_DH_mm && a.proxy.density == b.proxy.density &&
         a.proxy.moves == b.proxy.moves && a.force_D_n == b.force_D_n;
}

template <class Taker>
void RunPass(const HapticSurface& surface, const HapticSettings& settings,
             const std::vector<Vec3>& hips_mm, Taker take) {
  using Clock = std::chrono::steady_clock;
  const auto state = std::make_unique<RendererState>();
  for (std::size_t n = 0; n < hips_mm.size(); ++n) {
    const auto start = Clock::now();
    const HapticOutput output = StepRenderer(surface, settings, hips_mm[n], kReplayPeriodS, *state);
    const auto update = std::chrono::nanoseconds(Clock::now() - start);
    take(n, output, update.count(), *state);
  }
}

}  // namespace

std::vector<ReplayTick> Replay(const HapticSurface& surface, const HapticSettings& settings,
                               const std::vector<Vec3>& hips_mm, int passes) {
  std::vector<ReplayTick> ticks(hips_mm.size());
  RunPass(
      surface, settings, hips_mm,
      [&](std::size_t n, const HapticOutput& output, std::int64_t update_ns, RendererState& state) {
        ticks[n] = {hips_mm[n], state.has_hip, output, VisualProxyOf(surface, output, state),
                    update_ns};
      });
  for (int pass = 1; pass < passes; ++pass) {
    RunPass(surface, settings, hips_mm,
            [&](std::size_t n, const HapticOutput& output, std::int64_t update_ns, RendererState&) {
              ticks[n].update_ns = std::min(ticks[n].update_ns, update_ns);
              if (AreSame(output, ticks[n].output)) return;
              throw Error(ErrorKind::kInternal,
                          "tick " + std::to_string(n) + " differs between identical passes");
            });
  }
  return ticks;
}

}  // namespace palpate::lab
