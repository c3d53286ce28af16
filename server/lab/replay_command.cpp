#include "server/lab/commands.h"

#include <fmt/core.h>

#include <algorithm>
#include <ostream>
#include <thread>

#include "common/error/error.h"
#include "server/lab/lab_arguments.h"
#include "server/lab/led_hips.h"
#include "server/lab/mesh.h"
#include "server/lab/trajectory.h"
#include "server/lab/trajectory_file.h"
#include "server/lab/triangle_grid.h"
#include "server/volume/snapshot/ball_field.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate::lab {
namespace {

std::optional<Vec3> ParseSpacing(const std::vector<double>& numbers) {
  if (numbers.empty()) return std::nullopt;
  for (double number : numbers) {
    if (number >= kLeastSpacingMm && number <= kGreatestSpacingMm) continue;
    throw Error(ErrorKind::kInvalidArgument,
                fmt::format("spacing {}: give it in mm, from {} to {}", number, kLeastSpacingMm,
                            kGreatestSpacingMm));
  }
  if (numbers.size() == 1) return Vec3::Constant(numbers[0]);
  if (numbers.size() == 3) return Vec3(numbers[0], numbers[1], numbers[2]);
  throw Error(ErrorKind::kInvalidArgument, "give the spacing as one number or three, in mm");
}

HapticSettings ParseSettings(const ReplayOptions& options) {
  HapticSettings settings;
  for (const std::string& argument : options.settings) ApplySetting(argument, settings);
  if (options.stiffness_n_per_mm) {
    ApplySetting(fmt::format("stiffness_n_per_mm={}", *options.stiffness_n_per_mm), settings);
  }
  if (options.refinement) settings.refinement = *options.refinement;
  return settings;
}

HapticSurface SurfaceOf(const LoadedSurface& loaded, DecompositionMethod method,
                        const HapticSettings& settings) {
  return MakeHapticSurface(*loaded.volume, loaded.volume->metadata().WorldFromIndex(),
                           loaded.isovalue, method, 1, settings.free_side,
                           static_cast<int>(settings.refinement));
}

std::shared_ptr<const VolumeSnapshot> FieldOfBall(double voxels, const VolumeSnapshot& volume) {
  const AffineMap X_WI = volume.metadata().WorldFromIndex();
  const Ball ball{.radius_mm = voxels * X_WI.linear.colwise().norm().minCoeff(),
                  .device_from_index = X_WI.linear};
  if (!CanBe(ball)) {
    Refuse(fmt::format("a ball of {} voxels: its radius is {} to {}", voxels, kLeastBallVoxels,
                       kMostBallVoxels));
  }
  const BallField field(ball);
  const int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  return field.Of(volume, threads, [](double) {});
}

}  // namespace

LoadedSurface LoadSurface(const SurfaceOptions& options) {
  const std::optional<Vec3> spacing_mm = ParseSpacing(options.spacing_mm);
  LoadedSurface loaded;
  loaded.volume = LoadVolume(options.volume, options.import_program, {}, spacing_mm);
  const std::optional<double> isovalue = options.isovalue;
  loaded.isovalue = options.normalized ? ChooseIsovalue(*loaded.volume, std::nullopt, isovalue)
                                       : ChooseIsovalue(*loaded.volume, isovalue, std::nullopt);
  if (options.ball_voxels != 0.0) loaded.volume = FieldOfBall(options.ball_voxels, *loaded.volume);
  return loaded;
}

JudgedReplay ReplayAndJudge(const LoadedSurface& loaded, DecompositionMethod method,
                            const HapticSettings& settings, const std::vector<Vec3>& hips_mm,
                            int passes) {
  const HapticSurface surface = SurfaceOf(loaded, method, settings);
  JudgedReplay judged;
  judged.ticks = Replay(surface, settings, hips_mm, passes);
  const TriangleGrid triangles(ExtractSurface(surface.lattice, loaded.isovalue, Compared(method),
                                              PaddedCells(surface.lattice)),
                               surface.X_DL);
  judged.summary = Summarise(judged.ticks, JudgeReplay(surface, settings, triangles, judged.ticks));
  return judged;
}

void RunReplay(const ReplayOptions& options, std::ostream& out) {
  const HapticSettings settings = ParseSettings(options);
  CheckNewFile(options.output, ReplacesIf(options.overwrite));
  std::vector<Vec3> hips_mm = ReadTrajectory(options.trajectory);
  const LoadedSurface loaded = LoadSurface(options.surface);
  const DecompositionMethod method = *Named<DecompositionMethod>(options.method);
  if (options.hand) hips_mm = HipsOfLedHand(SurfaceOf(loaded, method, settings), settings, hips_mm);
  const JudgedReplay judged = ReplayAndJudge(loaded, method, settings, hips_mm, options.passes);
  WriteText(options.output, ToCsv(judged.ticks, judged.summary.verdict.density),
            ReplacesIf(options.overwrite));
  out << ToJson(judged.summary) << "\n";
}

void RunTrajectory(const TrajectoryOptions& options) {
  CheckNewFile(options.output, ReplacesIf(options.overwrite));
  const LoadedSurface loaded = LoadSurface(options.surface);
  const TrajectoryRequest request{.kind = *TrajectoryNamed(options.kind),
                                  .isovalue = loaded.isovalue,
                                  .speed_cm_per_s = options.speed_cm_per_s,
                                  .ticks = options.ticks,
                                  .seed = options.seed};
  WriteTrajectory(options.output, MakeTrajectory(*loaded.volume, request),
                  ReplacesIf(options.overwrite));
}

}  // namespace palpate::lab
