// Steps the renderer, for a program that counts instructions: those of CountedTicks are the ticks'
// own. Prints the ticks, how many were in contact, and the mean time of one.
//
//   counted_ticks REFINEMENT SLIDE         a slide of palpate-lab bench
//   counted_ticks REFINEMENT free VOXELS   to and fro in free space, VOXELS in each tick
//   counted_ticks REFINEMENT along VOXELS  likewise along a wavy surface
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "server/haptics/renderer.h"
#include "server/lab/commands.h"
#include "server/lab/replay.h"
#include "server/lab/trajectory.h"
#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/snapshot_builder.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

constexpr int kCounted = 10'000;
// The way into the object, and cells that are new to the cache, come first.
constexpr int kFirst = 2'000;
// Of steps that are long enough to count with fewer.
constexpr int kSteps = 200, kFirstSteps = 20;

struct Ride {
  std::shared_ptr<const VolumeSnapshot> volume{};
  double isovalue = 0.5;
  std::vector<Vec3> hips_mm{};
  int first = 0;  // the first that counts
};

Ride Slide(const lab::FixedSlide& slide) {
  const BuiltinVolume made = MakeBuiltin(slide.volume, Vec3::Constant(slide.spacing_mm));
  Ride ride{.volume = MakeSnapshot(made.grid, made.metadata, 1), .first = kFirst};
  ride.isovalue = ride.volume->Normalize(0.5);
  ride.hips_mm = lab::MakeTrajectory(*ride.volume, {.isovalue = ride.isovalue,
                                                    .speed_cm_per_s = slide.speed_cm_per_s,
                                                    .ticks = kFirst + kCounted});
  return ride;
}

// Voxels of 1 mm. Steps begin at all places between two voxels.
Ride ToAndFro(double voxels, double z_mm) {
  Ride ride{.first = kFirstSteps};
  ride.volume = testing::MakeVolume({1032, 24, 24}, [](int i, int j, int k) {
    return 12.0 - k + std::sin(0.31 * i) + std::sin(0.23 * j);
  });
  ride.isovalue = ride.volume->Normalize(0.0);
  for (int n = 0; n < kFirstSteps + kSteps; ++n) {
    const double x_mm = 10.0 + std::fmod(0.618 * n, 1.0) + (n % 2 == 0 ? 0.0 : voxels);
    ride.hips_mm.emplace_back(x_mm, 11.3, z_mm);
  }
  return ride;
}

}  // namespace

[[gnu::noinline]] int CountedTicks(const HapticSurface& surface, std::span<const Vec3> hips_mm,
                                   RendererState& state) {
  const HapticSettings settings{};
  int contacts = 0;
  for (const Vec3& hip_mm : hips_mm) {
    const HapticOutput output = StepRenderer(surface, settings, hip_mm, lab::kReplayPeriodS, state);
    contacts += lab::IsInContact(output);
  }
  return contacts;
}

void Run(const Ride& ride, int refinement) {
  const HapticSurface surface =
      MakeHapticSurface(*ride.volume, ride.volume->metadata().WorldFromIndex(), ride.isovalue,
                        DecompositionMethod::kTpbcc, 1, FreeSide::kBelow, refinement);
  const auto state = std::make_unique<RendererState>();
  const std::span<const Vec3> hips_mm(ride.hips_mm);
  for (const Vec3& hip_mm : hips_mm.first(static_cast<std::size_t>(ride.first))) {
    StepRenderer(surface, HapticSettings{}, hip_mm, lab::kReplayPeriodS, *state);
  }
  const auto counted = hips_mm.subspan(static_cast<std::size_t>(ride.first));
  const auto begin = std::chrono::steady_clock::now();
  const int contacts = CountedTicks(surface, counted, *state);
  const std::chrono::duration<double, std::micro> way = std::chrono::steady_clock::now() - begin;
  std::printf("%zu ticks, %d in contact, %.3f us\n", counted.size(), contacts,
              way.count() / static_cast<double>(counted.size()));
}

}  // namespace palpate

int main(int count, char** arguments) {
  using namespace palpate;
  const int refinement = count > 1 ? std::atoi(arguments[1]) : 0;
  const std::string_view what = count > 2 ? arguments[2] : "";
  const auto* slide = std::ranges::find(lab::kFixedSlides, what, &lab::FixedSlide::name);
  if (refinement < 1 || refinement > kMaxRefinement) return EXIT_FAILURE;
  if (count == 3 && slide != lab::kFixedSlides.end()) {
    Run(Slide(*slide), refinement);
  } else if (count == 4 && (what == "free" || what == "along")) {
    Run(ToAndFro(std::atof(arguments[3]), what == "free" ? 18.4 : 10.4), refinement);
  } else {
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}
