// Table 3: how long a haptic update takes while a hand explores.
#include <algorithm>
#include <filesystem>

#include "server/lab/experiment_parts.h"
#include "server/lab/replay_command.h"
#include "server/lab/trajectory.h"

namespace palpate::lab {
namespace {

struct ExploredVolume {
  const char* name;
  const char* source;  // builtin name, or path below the data folder
  double isovalue;     // normalised, from Table 2
};

// Visible Male and Neuron are not available: a CT head and another neuron replace them.
constexpr ExploredVolume kVolumes[] = {
    {"cylinder", "builtin:cylinder", 0.12},
    {"daisy", "paper/daisy_192x180x168_uint8.nhdr", 0.02},
    {"head (for Visible Male)", "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", 0.33},
    {"lobster", "paper/lobster_301x324x56_uint8.nhdr", 0.16},
    {"neuron (another)", "paper/SUBST_neuron_janelia_511x512x47_uint8.nrrd", 0.12},
    {"orange", "paper/orange_256x256x64_uint8.nhdr", 0.22},
};

struct Resolution {
  const char* name;
  double spacing_mm;
  const char* published_ms;
};
constexpr Resolution kResolutions[] = {{"1 mm = 1/2 cell", 2.0, "0.21-0.35"},
                                       {"1 mm = 3 cells", 1.0 / 3.0, "0.33-0.44"}};

// Mean speed of the HIP in cm/s, without jumps.
double MeanSpeed(const std::vector<Vec3>& hips_mm) {
  constexpr double kFastestMm = 1.0;  // per tick; faster steps are jumps
  constexpr double kCmPerMm = 0.1;
  double way_mm = 0.0;
  int steps = 0;
  for (std::size_t n = 1; n < hips_mm.size(); ++n) {
    const double step_mm = (hips_mm[n] - hips_mm[n - 1]).norm();
    if (step_mm <= kFastestMm) way_mm += step_mm, ++steps;
  }
  return steps > 0 ? way_mm * kCmPerMm / (steps * kReplayPeriodS) : 0.0;
}

void Explore(const ExploredVolume& volume, const Resolution& resolution,
             const ExperimentOptions& options, std::ostream& out) {
  const bool builtin = std::string_view(volume.source).starts_with("builtin:");
  const std::filesystem::path source =
      builtin ? std::filesystem::path(volume.source) : options.data_folder / volume.source;
  if (!builtin && !std::filesystem::exists(source)) {
    Print(out, "%-24s not found; give its folder with --data\n", volume.name);
    return;
  }
  const LoadedSurface loaded = LoadSurface({.volume = source.string(),
                                            .isovalue = volume.isovalue,
                                            .normalized = true,
                                            .spacing_mm = {resolution.spacing_mm}});
  const std::vector<Vec3> hips_mm = MakeTrajectory(
      *loaded.volume,
      {.kind = TrajectoryKind::kFreehand, .isovalue = loaded.isovalue, .seed = options.seed});
  HapticSettings settings;
  settings.refinement = options.refinement;
  const ReplaySummary s =
      ReplayAndJudge(loaded, DecompositionMethod::kTpbcc, settings, hips_mm, 1).summary;
  Print(out, "%-24s %9.5f  %-10s %7.2f %9.1f %6.1f %7d %6d\n", volume.name, s.mean_ns * 1e-6,
        resolution.published_ms, static_cast<double>(s.p99_ns) * 1e-3, MeanSpeed(hips_mm),
        100.0 * s.contact_share(), s.verdict.fall_throughs, *s.verdict.sticks);
}

}  // namespace

void PrintTable3(const ExperimentOptions& options, std::ostream& out) {
  Print(out,
        "Table 3: time of one haptic update while a hand explores for 60 s. Published: Intel i5,\n"
        "3 GHz, stylus at 5 to 19 cm/s, in contact for 63 to 85 %% of the time.\n");
  for (const Resolution& resolution : kResolutions) {
    Print(out, "\n%-24s %9s  %-10s %7s %9s %6s %7s %6s\n", resolution.name, "mean ms", "published",
          "p99 us", "cm/s", "felt%", "through", "stick");
    for (const ExploredVolume& volume : kVolumes) Explore(volume, resolution, options, out);
  }
}

}  // namespace palpate::lab
