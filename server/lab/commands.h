// The commands of palpate-lab, besides its experiments (experiments.h).
#pragma once

#include <array>
#include <filesystem>
#include <iosfwd>
#include <istream>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "common/isosurface/decomposition.h"
#include "server/lab/compared_method.h"
#include "server/lab/lab_arguments.h"
#include "server/lab/replay_report.h"
#include "server/volume/snapshot/snapshot.h"

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

// palpate-lab replay and palpate-lab trajectory.
//
// Threads: the calling one; H is extracted on all cores. Errors: Error.
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

// palpate-lab bench: judges and times the fixed slides.
//
// Each slide has 60 000 ticks, 1.0 ± 0.2 mm below the surface at 0.5 N/mm. The volumes are
// computed, not loaded, so that results from different machines or versions are comparable.
// Threads: the calling one; H is extracted on all cores. Errors: Error.
struct FixedSlide {
  const char* name;
  const char* volume;  // a builtin volume; the isovalue is ½
  double spacing_mm;
  double speed_cm_per_s;
};

inline constexpr std::array<FixedSlide, 8> kFixedSlides = {{
    {"bumps_coarse_10", "builtin:bumps:128", 2.0, 10.0},
    {"bumps_coarse_50", "builtin:bumps:128", 2.0, 50.0},
    {"bumps_fine_10", "builtin:bumps:128", 1.0 / 3.0, 10.0},
    {"bumps_fine_50", "builtin:bumps:128", 1.0 / 3.0, 50.0},
    {"gyroid_coarse_10", "builtin:gyroid:128", 2.0, 10.0},
    {"gyroid_coarse_50", "builtin:gyroid:128", 2.0, 50.0},
    {"gyroid_fine_10", "builtin:gyroid:128", 1.0 / 3.0, 10.0},
    {"gyroid_fine_50", "builtin:gyroid:128", 1.0 / 3.0, 50.0},
}};

ReplaySummary RunFixedSlide(const FixedSlide& slide, int passes, int refinement = 1,
                            double ball_voxels = 0.0);

struct BenchOptions {
  bool json = false;  // one line with one object that holds an object per slide; false: a table
  int passes = 1;
  int refinement = 2;
  double ball_voxels = 0.0;  // 0: a point
};

void RunBench(const BenchOptions& options, std::ostream& out);

// palpate-lab cells: writes decompositions of single cells as JSON lines.
//
// Each input line holds 8 densities d0..d7, or the indices i, j, k of a cell if a volume is given.
// Commas or blanks separate the columns. Further columns are ignored, and lines that start with '#'
// are skipped.
// Ties are resolved as in a volume. Without a volume, they are resolved over the cell's own range,
// with the lattice index (0, 0, 0).
// Errors: Error (kInvalidArgument) with the line's number.
//
// Writes one line per cell:
// {"sigma_f":..,"sigma_c":..,"vertices":[[x,y,z,density],..],"tetrahedra":[..]}
// Without a volume, densities are in the units of the input. With a volume, they are normalised
// over its range, as in the renderer.
void DecomposeCells(std::istream& in, std::ostream& out, ComparedMethod method,
                    const VolumeSnapshot* volume);

// palpate-lab mesh: counts and writes the whole haptic isosurface of a volume.
//
// Threads: the calling one; works on all cores. Errors: Error.
struct MeshOptions {
  std::string volume;  // a path, or a builtin name
  // Give exactly one: in data units, or 0 to 1 over the volume's range.
  std::optional<double> isovalue{};
  std::optional<double> normalized_isovalue{};
  std::string method = "tpbcc";  // one of kMethodNames
  int refinement = 1;
  std::filesystem::path output;  // .ply or .obj; empty: no file, only counts
  bool overwrite = false;        // of `output`
  std::filesystem::path import_program = ImportProgramBesideThis();
};

// Prints one "name value" per line on standard output. Shows a progress bar on standard error if
// that is a terminal. Returns the exit status, 0.
int RunMesh(const MeshOptions& options);

// palpate-lab replay --recording, and export.
//
// Threads: the calling one. Errors: Error.
struct RecordingReplayOptions {
  std::filesystem::path recording{};
  // Loaded instead of the first volume that the recording names but does not hold. Empty: the
  // volume that the recording names is loaded.
  std::string volume{};
  bool allow_missing = false;
  std::filesystem::path import_program = ImportProgramBesideThis();
};

// Computes the recording again and prints the results of the comparison. Throws Error:
//   kInternal             a tick differs
//   the load's own error  no tick could be compared because the volume could not be loaded
//   kConflict             no tick could be compared for another reason, or the volume or the scene
//                         of some ticks is missing and options.allow_missing is false
void ReplayRecording(const RecordingReplayOptions& options, std::ostream& out);

struct ExportOptions {
  std::filesystem::path recording{};
  std::filesystem::path output{};  // empty: writes to `out`
  bool overwrite = false;          // of `output`
  bool hdf5 = false;               // refused: the error names what writes it
};

// Writes the recording's table of ticks as CSV.
void ExportRecording(const ExportOptions& options, std::ostream& out);

}  // namespace palpate::lab
