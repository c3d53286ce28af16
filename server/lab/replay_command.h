// palpate-lab replay and palpate-lab trajectory.
//
// Threads: the calling one; H is extracted on all cores. Errors: Error.
#pragma once

#include <filesystem>
#include <iosfwd>
#include <optional>
#include <string>
#include <vector>

#include "common/isosurface/decomposition.h"
#include "server/lab/load_volume.h"
#include "server/lab/replay_report.h"

namespace palpate::lab {

// The volume and the surface in it. Both commands take these options.
struct SurfaceOptions {
  std::string volume;  // a path, or a builtin name
  double isovalue = 0.0;
  bool normalized = false;  // true: isovalue is 0 to 1 over the volume's range; false: data units
  std::vector<double> spacing_mm{};  // one number or three; empty: the volume's own
  double ball_voxels = 0.0;          // radius, of the shortest edge; 0: a point
  std::filesystem::path import_program = ImportProgramBesideThis();
};

struct ReplayOptions {
  SurfaceOptions surface{};
  std::filesystem::path trajectory{};
  std::filesystem::path output{};
  bool overwrite = false;        // of `output`
  std::string method = "tpbcc";  // one that can be felt
  std::optional<double> stiffness_n_per_mm{};
  std::optional<int> refinement{};
  int passes = 1;
  bool hand = false;                    // the trajectory leads a hand that the force deflects
  std::vector<std::string> settings{};  // key=value
};

struct TrajectoryOptions {
  SurfaceOptions surface{};
  std::string kind = "slide";  // one of kTrajectoryNames
  double speed_cm_per_s = 10.0;
  int ticks = 60'000;
  std::uint64_t seed = 1;
  std::filesystem::path output{};
  bool overwrite = false;  // of `output`
};

// A volume and the normalised isovalue of the surface in it. With a ball, the volume is the field
// that the ball feels from below.
struct LoadedSurface {
  std::shared_ptr<const VolumeSnapshot> volume;
  double isovalue = 0.0;
};
LoadedSurface LoadSurface(const SurfaceOptions& options);

// Replays and judges.
struct JudgedReplay {
  std::vector<ReplayTick> ticks;
  ReplaySummary summary;
};
JudgedReplay ReplayAndJudge(const LoadedSurface& loaded, DecompositionMethod method,
                            const HapticSettings& settings, const std::vector<Vec3>& hips_mm,
                            int passes);

// Writes the table of ticks, then a line of JSON to `out`.
void RunReplay(const ReplayOptions& options, std::ostream& out);

void RunTrajectory(const TrajectoryOptions& options);

}  // namespace palpate::lab
