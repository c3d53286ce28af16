// palpate-lab: offline tools around the haptic isosurface.

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "common/arguments/arguments.h"
#include "common/error/error.h"
#include "server/lab/commands.h"
#include "server/lab/experiments.h"
#include "server/lab/lab_arguments.h"
#include "server/lab/trajectory.h"

namespace palpate::lab {
namespace {

struct Options {
  std::string method = "tpbcc";
  std::string volume;
  MeshOptions mesh;
  ExperimentOptions experiment;
  ReplayOptions replay;
  TrajectoryOptions trajectory;
  BenchOptions bench;
  RecordingReplayOptions recording;
  ExportOptions table;
};

// The table lies in a folder beside the programs' folder, both in the build tree and when
// installed.
std::filesystem::path DefaultTable() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path() /
         "share/palpate/table4.csv";
}

const std::vector<std::string> kMethods(kMethodNames.begin(), kMethodNames.end());
const std::vector<std::string> kFeltMethods(kWords<DecompositionMethod>.begin(),
                                            kWords<DecompositionMethod>.end());
const std::vector<std::string> kTrajectories(kTrajectoryNames.begin(), kTrajectoryNames.end());

void AddOverwrite(arguments::Command& command, bool& overwrite) {
  command.add_flag("--overwrite", overwrite, "replace a file that is there");
}

constexpr const char* kAboutRefine =
    "parts that each edge of a voxel is cut into for the surface, 1 to 4";

void AddRefine(arguments::Command& command, int& refinement) {
  command.add_option("--refine", refinement, kAboutRefine)
      ->check(arguments::Range(1, kMaxRefinement))
      ->capture_default_str();
}

arguments::Command* AddCells(arguments::Command& app, Options& options) {
  arguments::Command* cells = app.add_subcommand(
      "cells",
      "Decomposes single cells: reads lines of 8 densities d0..d7 from standard input and writes\n"
      "one JSON object per line. Commas or blanks separate the columns. Further columns are\n"
      "ignored, and lines that start with # are skipped. Ties are resolved over the cell's own\n"
      "range");
  cells->add_option("--method", options.method, "decomposition")
      ->check(arguments::IsMember(kMethods))
      ->capture_default_str();
  cells->add_option("--volume", options.volume,
                    "a volume file or builtin name. Each line then holds the indices i,j,k of a "
                    "cell, from -1 (the padding) on. Densities are normalised over the volume's "
                    "range, as in the renderer");
  cells->footer("Example: echo '0 1 0 1 1 0 1 0' | palpate-lab cells");
  return cells;
}

arguments::Command* AddMesh(arguments::Command& app, Options& options) {
  arguments::Command* mesh = app.add_subcommand(
      "mesh",
      "Extracts the whole haptic isosurface H of a volume as a triangle mesh, closed at the\n"
      "volume's border, and prints its counts");
  mesh->add_option("--volume", options.mesh.volume, "volume file, DICOM folder or builtin name")
      ->required();
  arguments::Option* isovalue =
      mesh->add_option("--isovalue", options.mesh.isovalue, "isovalue in data units");
  mesh->add_option("--normalized-isovalue", options.mesh.normalized_isovalue,
                   "isovalue over the volume's range, 0 to 1")
      ->excludes(isovalue);
  mesh->add_option("--method", options.mesh.method, "decomposition")
      ->check(arguments::IsMember(kMethods))
      ->capture_default_str();
  AddRefine(*mesh, options.mesh.refinement);
  mesh->add_option("--out", options.mesh.output,
                   "file to write, .ply or .obj, in world mm (LPS) [no file, only counts]");
  AddOverwrite(*mesh, options.mesh.overwrite);
  mesh->footer("Example: palpate-lab mesh --volume head.nrrd --isovalue 300 --out bone.ply");
  return mesh;
}

arguments::Command* AddExperiment(arguments::Command& app, Options& options) {
  arguments::Command* experiment = app.add_subcommand(
      "experiment", "Repeats an experiment of the paper and prints its results beside ours");
  experiment->add_option("name", options.experiment.name, "name of the experiment")
      ->required()
      ->check(arguments::IsMember(ExperimentNames()));
  experiment->add_option("--table", options.experiment.table,
                         "the paper's Table 4 as CSV [the one that comes with the program]");
  experiment
      ->add_option("--cells", options.experiment.cells,
                   "cells of each kind, for `topology` and `diamond`")
      ->check(arguments::Range(1, 100'000'000))
      ->capture_default_str();
  experiment
      ->add_option("--columns", options.experiment.columns, "columns per axis, to integrate R_D")
      ->check(arguments::Range(1, 10'000))
      ->capture_default_str();
  AddRefine(*experiment, options.experiment.refinement);
  experiment->add_option("--out", options.experiment.output_folder, "folder for the figures (SVG)")
      ->capture_default_str();
  AddOverwrite(*experiment, options.experiment.overwrite);
  experiment
      ->add_option("--data", options.experiment.data_folder,
                   "folder of the volumes of `table3` and `diamond`: "
                   "paper/daisy_192x180x168_uint8.nhdr, ...")
      ->capture_default_str();
  experiment->footer("Example: palpate-lab experiment table4");
  return experiment;
}

void AddBall(arguments::Command& command, double& voxels) {
  command.add_option("--ball", voxels,
                     "radius of a ball at the tip, in voxels of the shortest edge [0: a point]");
}

void AddSurface(arguments::Command& command, SurfaceOptions& options) {
  command.add_option("--volume", options.volume, "volume file, DICOM folder or builtin name")
      ->required();
  command.add_option("--isovalue", options.isovalue, "isovalue in data units")->required();
  command.add_flag("--normalized", options.normalized,
                   "the isovalue is 0 to 1 over the volume's range, not in data units");
  command
      .add_option("--spacing-mm", options.spacing_mm,
                  "voxel spacing instead of the volume's own: one number, or one per axis")
      ->expected(1, 3);
  AddBall(command, options.ball_voxels);
}

// A replay of a trajectory and a replay of a recording share only the option --volume.
void AddRecordingReplay(arguments::Command& replay, RecordingReplayOptions& options) {
  arguments::Option* recording =
      replay.add_option("--recording", options.recording,
                        "replays a recording of palpated instead of a trajectory: computes its "
                        "ticks again and compares them bit for bit. --volume then names the "
                        "recorded volume [its place when recorded, or the recording itself]");
  replay
      .add_flag("--allow-missing", options.allow_missing,
                "with --recording: only counts ticks whose volume is missing, without an error")
      ->needs(recording);
  std::vector<arguments::Option*> needed;
  for (const char* name : {"--isovalue", "--trajectory", "--out"}) {
    needed.push_back(replay.get_option(name)->required(false));
  }
  needed.push_back(replay.get_option("--volume")->required(false));
  for (const char* name :
       {"--isovalue", "--trajectory", "--out", "--normalized", "--spacing-mm", "--method",
        "--refine", "--stiffness", "--passes", "--set", "--hand", "--ball"}) {
    recording->excludes(replay.get_option(name));
  }
  replay.callback([recording, needed] {
    if (recording->count() > 0) return;
    for (const arguments::Option* option : needed) {
      if (option->count() == 0) {
        throw arguments::UsageError(option->get_name() + " is required");
      }
    }
  });
}

arguments::Command* AddExport(arguments::Command& app, ExportOptions& options) {
  arguments::Command* command = app.add_subcommand(
      "export", "Writes a recording of palpated as a table: CSV, a row per tick; mm, N");
  command->add_option("recording", options.recording, "file to read")->required();
  command->add_option("--out", options.output, "file to write [standard output]");
  command->add_flag("--hdf5", options.hdf5, "says how the Python package writes HDF5 instead");
  AddOverwrite(*command, options.overwrite);
  command->footer("Example: palpate-lab export trial-7.mcap --out trial-7.csv");
  return command;
}

arguments::Command* AddReplay(arguments::Command& app, ReplayOptions& options) {
  arguments::Command* replay = app.add_subcommand(
      "replay",
      "Leads the renderer along a trajectory of the HIP: one position per millisecond, in the\n"
      "volume's world frame (mm). Writes the proxy and the force of every tick. Ends with a line\n"
      "of JSON: the counts of errors, and times. Except for the column update_ns, the output is\n"
      "the same on every run. Friction holds the proxy on purpose, so sticks are null if friction\n"
      "is set");
  AddSurface(*replay, options.surface);
  replay
      ->add_option("--trajectory", options.trajectory,
                   "CSV with the header x_mm,y_mm,z_mm, or the output of a replay")
      ->required();
  replay->add_option("--out", options.output, "CSV to write, a row per tick; mm, N")->required();
  AddOverwrite(*replay, options.overwrite);
  replay->add_option("--method", options.method, "decomposition")
      ->check(arguments::IsMember(kFeltMethods))
      ->capture_default_str();
  replay->add_option("--refine", options.refinement, std::string(kAboutRefine) + " [2]")
      ->check(arguments::Range(1, kMaxRefinement));
  replay->add_option("--stiffness", options.stiffness_n_per_mm, "N/mm [0.5]");
  replay
      ->add_option("--passes", options.passes,
                   "identical passes; the shortest time of each tick counts")
      ->check(arguments::Range(1, 1000))
      ->capture_default_str();
  replay->add_flag(
      "--hand", options.hand,
      "the trajectory leads a simulated hand, which the force deflects: 0.3 N for each\n"
      "mm, as the led hand of palpated");
  replay->add_option("--set", options.settings, "settings of the renderer, as key=value");
  replay->footer(
      "Example: palpate-lab replay --volume builtin:bumps --isovalue 0.5 --normalized \\\n"
      "           --trajectory slide.csv --out felt.csv --set damping_n_s_per_m=1\n"
      "         palpate-lab replay --recording trial-7.mcap");
  return replay;
}

arguments::Command* AddTrajectory(arguments::Command& app, TrajectoryOptions& options) {
  arguments::Command* trajectory = app.add_subcommand(
      "trajectory", "Writes a trajectory over the surface of a volume, for replay");
  AddSurface(*trajectory, options.surface);
  trajectory
      ->add_option("--kind", options.kind,
                   "slide: 1 mm below the surface; freehand: sometimes below, sometimes above; "
                   "random: an attack")
      ->check(arguments::IsMember(kTrajectories))
      ->capture_default_str();
  trajectory->add_option("--speed-cm-per-s", options.speed_cm_per_s, "speed of slides")
      ->check(arguments::Range(0.0, 1000.0))
      ->capture_default_str();
  trajectory->add_option("--ticks", options.ticks, "number of positions, one per millisecond")
      ->check(arguments::Range(1, 100'000'000))
      ->capture_default_str();
  trajectory->add_option("--seed", options.seed, "each seed gives another trajectory")
      ->capture_default_str();
  trajectory->add_option("--out", options.output, "CSV to write")->required();
  AddOverwrite(*trajectory, options.overwrite);
  return trajectory;
}

arguments::Command* AddBench(arguments::Command& app, BenchOptions& options) {
  arguments::Command* bench =
      app.add_subcommand("bench", "Replays the fixed slides: counts and times, as a table");
  bench->add_flag("--json", options.json, "one line of JSON instead");
  bench->add_option("--passes", options.passes, "as for replay")
      ->check(arguments::Range(1, 1000))
      ->capture_default_str();
  AddRefine(*bench, options.refinement);
  AddBall(*bench, options.ball_voxels);
  return bench;
}

void RunCells(const Options& options) {
  std::ios::sync_with_stdio(false);
  const auto volume =
      options.volume.empty() ? nullptr : LoadVolume(options.volume, ImportProgramBesideThis());
  DecomposeCells(std::cin, std::cout, *MethodNamed(options.method), volume.get());
}

void RunReplays(Options& options) {
  if (options.recording.recording.empty()) return RunReplay(options.replay, std::cout);
  options.recording.volume = options.replay.surface.volume;
  ReplayRecording(options.recording, std::cout);
}

int Run(int argc, char** argv) {
  arguments::Command app(
      "palpate-lab: cells, meshes, replays and experiments around the haptic isosurface");
  app.require_subcommand(1);
  app.set_version_flag("--version", "palpate-lab " PALPATE_VERSION);
  Options options;
  const arguments::Command* cells = AddCells(app, options);
  const arguments::Command* mesh = AddMesh(app, options);
  const arguments::Command* experiment = AddExperiment(app, options);
  arguments::Command* replay = AddReplay(app, options.replay);
  AddRecordingReplay(*replay, options.recording);
  const arguments::Command* table = AddExport(app, options.table);
  const arguments::Command* trajectory = AddTrajectory(app, options.trajectory);
  const arguments::Command* bench = AddBench(app, options.bench);
  try {
    if (!app.parse(argc, argv)) return 0;
  } catch (const arguments::UsageError& error) {
    app.explain(error);
    return kUsageExitCode;
  }
  try {
    if (cells->parsed()) RunCells(options);
    if (mesh->parsed()) RunMesh(options.mesh);
    if (replay->parsed()) RunReplays(options);
    if (table->parsed()) ExportRecording(options.table, std::cout);
    if (trajectory->parsed()) RunTrajectory(options.trajectory);
    if (bench->parsed()) RunBench(options.bench, std::cout);
    if (options.experiment.table.empty()) options.experiment.table = DefaultTable();
    if (experiment->parsed()) RunExperiment(options.experiment, std::cout);
    if (std::fflush(stdout) != 0 || !std::cout.flush()) {
      throw Error(ErrorKind::kUnavailable, "cannot write the output");
    }
    return 0;
  } catch (const Error& error) {
    std::fprintf(stderr, "palpate-lab: %s\n", error.what());
    return ExitCode(error.kind());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "palpate-lab: %s\n", error.what());
    return ExitCode(ErrorKind::kInternal);
  }
}

}  // namespace
}  // namespace palpate::lab

int main(int argc, char** argv) { return palpate::lab::Run(argc, argv); }
