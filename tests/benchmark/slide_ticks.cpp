// Steps the renderer along a fixed slide, for a program that counts instructions: those of
// CountedTicks are the ticks' own. See instructions_test.py.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <span>
#include <string_view>

#include "server/haptics/renderer.h"
#include "server/lab/bench.h"
#include "server/lab/replay.h"
#include "server/lab/trajectory.h"
#include "server/volume/builtin.h"
#include "server/volume/snapshot_builder.h"

namespace palpate {
namespace {

// The way into the object, and cells that are new to the cache, come first.
constexpr int kFirstCounted = 2'000;
constexpr int kCounted = 10'000;

}  // namespace

[[gnu::noinline]] int CountedTicks(const HapticSurface& surface, std::span<const Vec3> hips_mm,
                                   RendererState& state) {
  int contacts = 0;
  for (const Vec3& hip_mm : hips_mm) {
    const HapticOutput output =
        StepRenderer(surface, HapticSettings{}, hip_mm, lab::kReplayPeriodS, state);
    contacts += lab::IsInContact(output);
  }
  return contacts;
}

int Run(std::string_view name) {
  const auto* slide =
      std::ranges::find(lab::kFixedSlides, name, [](const auto& s) { return s.name; });
  if (slide == lab::kFixedSlides.end()) return EXIT_FAILURE;
  const BuiltinVolume made = MakeBuiltin(slide->volume, Vec3::Constant(slide->spacing_mm));
  const auto volume = MakeSnapshot(made.grid, made.metadata, 1);
  const double isovalue = volume->Normalize(0.5);
  const auto hips_mm = lab::MakeTrajectory(*volume, {.isovalue = isovalue,
                                                     .speed_cm_per_s = slide->speed_cm_per_s,
                                                     .ticks = kFirstCounted + kCounted});
  const HapticSurface surface = MakeHapticSurface(*volume, volume->metadata().WorldFromIndex(),
                                                  isovalue, DecompositionMethod::kTpbcc, 1);
  const auto state = std::make_unique<RendererState>();
  for (int n = 0; n < kFirstCounted; ++n) {
    StepRenderer(surface, HapticSettings{}, hips_mm[n], lab::kReplayPeriodS, *state);
  }
  const int contacts = CountedTicks(surface, std::span(hips_mm).subspan(kFirstCounted), *state);
  std::printf("%d ticks, %d in contact\n", kCounted, contacts);
  return EXIT_SUCCESS;
}

}  // namespace palpate

int main(int count, char** arguments) {
  return count == 2 ? palpate::Run(arguments[1]) : EXIT_FAILURE;
}
