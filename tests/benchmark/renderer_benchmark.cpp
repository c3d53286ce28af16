// Cost of one haptic update: in free space, sliding, in cells with six face
// saddles, with a cold cache, when τ changes, and where it is worst. See README.md.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <numeric>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "server/haptics/renderer.h"
#include "server/lab/trajectory.h"
#include "server/safety/safety.h"
#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/snapshot_builder.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

constexpr double kDtS = 1e-3;
constexpr int kTicks = 20'000;

struct Scene {
  std::shared_ptr<const VolumeSnapshot> volume;
  HapticSurface surface;
};

Scene MakeScene(std::shared_ptr<const VolumeSnapshot> volume, double isovalue) {
  Scene scene{std::move(volume), {}};
  scene.surface = MakeHapticSurface(*scene.volume, scene.volume->metadata().WorldFromIndex(),
                                    isovalue, DecompositionMethod::kTpbcc, 1);
  return scene;
}

// Made once: the library calls a benchmark several times.
const Scene& Builtin(const std::string& name, double spacing_mm) {
  static std::map<std::pair<std::string, double>, Scene> made;
  const auto [found, is_new] = made.try_emplace({name, spacing_mm});
  if (is_new) {
    const BuiltinVolume builtin = MakeBuiltin(name, Vec3::Constant(spacing_mm));
    const auto volume = MakeSnapshot(builtin.grid, builtin.metadata, 1);
    found->second = MakeScene(volume, volume->Normalize(0.5));
  }
  return found->second;
}

// Values high and low in turn, as on a chess board: most cells have six saddles.
Scene ChessBoard() {
  std::mt19937_64 random(13);
  std::uniform_real_distribution<double> uniform;
  return MakeScene(testing::MakeVolume(Vec3i::Constant(24),
                                       [&](int i, int j, int k) {
                                         return 0.5 * ((i + j + k) % 2) + 0.5 * uniform(random);
                                       }),
                   0.5);
}

// Steps through `hips` again and again, after change(surface, n); moves and contacts per step are
// counted.
template <typename Change>
void Run(benchmark::State& state, HapticSurface surface, const std::vector<Vec3>& hips,
         const HapticSettings& settings, const Change& change) {
  auto renderer = std::make_unique<RendererState>();
  std::size_t n = 0;
  double moves = 0.0, contacts = 0.0;
  for (auto _ : state) {
    change(surface, n);
    const HapticOutput output =
        StepRenderer(surface, settings, hips[n++ % hips.size()], kDtS, *renderer);
    benchmark::DoNotOptimize(output.force_D_n.data());
    moves += output.proxy.moves;
    contacts += output.proxy.mode == ProxyMode::kConstrained;
  }
  state.counters["moves"] = benchmark::Counter(moves, benchmark::Counter::kAvgIterations);
  state.counters["contact"] = benchmark::Counter(contacts, benchmark::Counter::kAvgIterations);
}

void Run(benchmark::State& state, const Scene& scene, const std::vector<Vec3>& hips,
         const HapticSettings& settings = {}) {
  Run(state, scene.surface, hips, settings, [](HapticSurface&, std::size_t) {});
}

std::vector<Vec3> SlideOver(const Scene& scene, double speed_cm_per_s) {
  return lab::MakeTrajectory(*scene.volume, {.kind = lab::TrajectoryKind::kSlide,
                                             .isovalue = scene.surface.isovalue,
                                             .speed_cm_per_s = speed_cm_per_s,
                                             .ticks = kTicks});
}

void Sliding(benchmark::State& state, const char* name, double spacing_mm, double speed_cm_per_s,
             const HapticSettings& settings = {}) {
  const Scene& scene = Builtin(name, spacing_mm);
  Run(state, scene, SlideOver(scene, speed_cm_per_s), settings);
}
BENCHMARK_CAPTURE(Sliding, bumps_coarse_10, "builtin:bumps:128", 2.0, 10.0);
BENCHMARK_CAPTURE(Sliding, bumps_coarse_50, "builtin:bumps:128", 2.0, 50.0);
BENCHMARK_CAPTURE(Sliding, bumps_fine_10, "builtin:bumps:128", 1.0 / 3.0, 10.0);
BENCHMARK_CAPTURE(Sliding, bumps_fine_50, "builtin:bumps:128", 1.0 / 3.0, 50.0);
BENCHMARK_CAPTURE(Sliding, gyroid_coarse_10, "builtin:gyroid:128", 2.0, 10.0);
BENCHMARK_CAPTURE(Sliding, gyroid_coarse_50, "builtin:gyroid:128", 2.0, 50.0);
BENCHMARK_CAPTURE(Sliding, gyroid_fine_10, "builtin:gyroid:128", 1.0 / 3.0, 10.0);
BENCHMARK_CAPTURE(Sliding, gyroid_fine_50, "builtin:gyroid:128", 1.0 / 3.0, 50.0);

// Renderer and safety four times in a millisecond: the share of a core, and p99.
void FourKilohertz(benchmark::State& state, const char* name, double spacing_mm) {
  constexpr double kPeriodS = kDtS / 4.0;
  const Scene& scene = Builtin(name, spacing_mm);
  const std::vector<Vec3> hips = SlideOver(scene, 50.0 / 4.0);  // its steps take kDtS
  const auto renderer = std::make_unique<RendererState>();
  Safety safety(SafetyLimits{});
  std::vector<double> times_s;
  for (auto _ : state) {
    const auto begin = std::chrono::steady_clock::now();
    const HapticOutput output =
        StepRenderer(scene.surface, {}, hips[times_s.size() % hips.size()], kPeriodS, *renderer);
    const Vec3 force_D_n =
        safety.Step({.wrench_D = {output.force_D_n}, .p_DHip_mm = output.p_DHip_mm}, kPeriodS)
            .force_n;
    benchmark::DoNotOptimize(force_D_n.data());
    times_s.push_back(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  }
  const double sum_s = std::reduce(times_s.begin(), times_s.end());
  state.counters["core"] = sum_s / (static_cast<double>(times_s.size()) * kPeriodS);
  std::ranges::sort(times_s);
  state.counters["p99_s"] = times_s[times_s.size() * 99 / 100];
}
BENCHMARK_CAPTURE(FourKilohertz, bumps_fine_50, "builtin:bumps:128", 1.0 / 3.0);
BENCHMARK_CAPTURE(FourKilohertz, gyroid_fine_50, "builtin:gyroid:128", 1.0 / 3.0);
BENCHMARK_CAPTURE(FourKilohertz, gyroid_coarse_50, "builtin:gyroid:128", 2.0);

// What each effect adds.
BENCHMARK_CAPTURE(Sliding, with_friction, "builtin:bumps:128", 1.0 / 3.0, 10.0,
                  HapticSettings{.static_friction = 0.4, .dynamic_friction = 0.2});
BENCHMARK_CAPTURE(Sliding, with_shading, "builtin:bumps:128", 1.0 / 3.0, 10.0,
                  HapticSettings{.force_shading = true});
BENCHMARK_CAPTURE(Sliding, with_passivity_control, "builtin:bumps:128", 1.0 / 3.0, 10.0,
                  HapticSettings{.passivity_control = true});

// 10 cm/s in the air, `height` voxels above a sphere of 0.35 edges.
void FreeSpace(benchmark::State& state, double height, const HapticSettings& settings) {
  const Scene& scene = Builtin("builtin:sphere:128", 1.0 / 3.0);
  const double radius = 0.35 * 128.0 + height;
  std::vector<Vec3> hips;
  for (int n = 0; n < kTicks; ++n) {
    const double angle = 0.3 / radius * n;
    const Vec3 p_I = Vec3::Constant(63.5) + radius * Vec3(std::cos(angle), std::sin(angle), 0.0);
    hips.push_back(scene.surface.X_DI.Apply(p_I));
  }
  Run(state, scene, hips, settings);
}
constexpr HapticSettings kMagnet{.magnet_force_n = 0.5, .magnet_range_mm = 1.5};
BENCHMARK_CAPTURE(FreeSpace, plain, 2.0, HapticSettings{});
BENCHMARK_CAPTURE(FreeSpace, magnet_near, 2.0, kMagnet);
BENCHMARK_CAPTURE(FreeSpace, magnet_out_of_reach, 7.0, kMagnet);

// Every step finds an empty cache: the data have a new revision.
void ColdCache(benchmark::State& state, const Scene& scene) {
  Run(state, scene.surface, SlideOver(scene, 10.0), {},
      [](HapticSurface& surface, std::size_t) { ++surface.geometry_revision; });
}
BENCHMARK_CAPTURE(ColdCache, bumps, Builtin("builtin:bumps:128", 1.0 / 3.0));
BENCHMARK_CAPTURE(ColdCache, six_saddles, ChessBoard());

void SixSaddles(benchmark::State& state) {
  const Scene scene = ChessBoard();
  Run(state, scene, SlideOver(scene, 50.0));
}
BENCHMARK(SixSaddles);

// τ moves the surface by a voxel to and fro, each step.
void IsovalueChange(benchmark::State& state) {
  const Scene& scene = Builtin("builtin:bumps:128", 1.0 / 3.0);
  Run(state, scene.surface, SlideOver(scene, 10.0), {}, [&](HapticSurface& surface, std::size_t n) {
    surface.isovalue = scene.surface.isovalue + (n % 2 ? 1.0 : -1.0) / 16.0;
  });
}
BENCHMARK(IsovalueChange);

// The stylus jumps to and fro below a great sphere, and the proxy follows over a
// third of its great circle.
void WorstCase(benchmark::State& state) {
  const Scene& scene = Builtin("builtin:sphere:256", 1.0 / 3.0);
  const double radius = 0.35 * 256.0 - 3.0;
  const auto hip = [&](double angle) {
    const Vec3 p_I = Vec3::Constant(127.5) + radius * Vec3(std::cos(angle), std::sin(angle), 0.1);
    return scene.surface.X_DI.Apply(p_I);
  };
  Run(state, scene, {hip(0.0), hip(1.0)});
}
BENCHMARK(WorstCase);

}  // namespace
}  // namespace palpate

BENCHMARK_MAIN();
