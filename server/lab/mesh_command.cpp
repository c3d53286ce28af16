#include "server/lab/commands.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <string_view>

#include "common/error/error.h"
#include "server/lab/mesh.h"
#include "server/lab/mesh_files.h"
#include "server/lab/mesh_statistics.h"

namespace palpate::lab {
namespace {

// One line on standard error, rewritten in place. Shows nothing if standard error is not a
// terminal.
class ProgressBar {
 public:
  ~ProgressBar() {
    if (shown_) std::fputs("\r\033[K", stderr);
  }

  void Show(std::string_view stage, double fraction) {
    if (!terminal_) return;
    constexpr int kBarWidth = 40;
    const double share = std::clamp(fraction, 0.0, 1.0);
    const std::string bar(static_cast<std::size_t>(share * kBarWidth), '#');
    std::fprintf(stderr, "\r\033[K%-12.*s [%-*s] %3.0f %%", static_cast<int>(stage.size()),
                 stage.data(), kBarWidth, bar.c_str(), 100.0 * share);
    shown_ = true;
  }

 private:
  const bool terminal_ = isatty(STDERR_FILENO) == 1;
  bool shown_ = false;
};

ComparedMethod ParseMethod(const std::string& name) {
  if (const auto method = MethodNamed(name)) return *method;
  std::string known;
  for (std::string_view each : kMethodNames) known += " " + std::string(each);
  throw Error(ErrorKind::kInvalidArgument, name + ": no such method; the methods are" + known);
}

void PrintCount(const char* name, std::int64_t count) {
  std::printf("%-28s %" PRId64 "\n", name, count);
}

void Print(const MeshStatistics& s, double seconds) {
  PrintCount("vertices", s.vertices);
  PrintCount("triangles", s.triangles);
  PrintCount("components", s.components);
  PrintCount("Euler characteristic", s.euler);
  PrintCount("boundary edges", s.boundary_edges);
  PrintCount("boundary edges off border", s.boundary_edges_off_border);
  PrintCount("non-manifold edges", s.non_manifold_edges);
  PrintCount("non-manifold vertices", s.non_manifold_vertices);
  if (s.IsManifold()) {
    PrintCount("genus", s.genus());
  } else {
    std::printf("%-28s undefined: not a manifold\n", "genus");
  }
  std::printf("%-28s %.2f\n", "seconds", seconds);
}

}  // namespace

int RunMesh(const MeshOptions& options) {
  const ComparedMethod method = ParseMethod(options.method);
  const IfThere if_there = ReplacesIf(options.overwrite);
  if (!options.output.empty()) {
    CheckMeshFileName(options.output);
    CheckNewFile(options.output, if_there);
  }
  MeshStatistics statistics;
  double seconds = 0.0;
  {
    ProgressBar bar;
    const auto volume =
        LoadVolume(options.volume, options.import_program,
                   [&](std::string_view stage, double fraction) { bar.Show(stage, fraction); });
    const double isovalue = ChooseIsovalue(*volume, options.isovalue, options.normalized_isovalue);
    const auto start = std::chrono::steady_clock::now();
    const Lattice lattice(*volume, options.refinement);
    const SurfaceMesh mesh =
        ExtractSurface(lattice, isovalue, method, PaddedCells(lattice),
                       [&](double fraction) { bar.Show("extracting", fraction); });
    seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    bar.Show("counting", 1.0);
    statistics = MeasureMesh(mesh);
    bar.Show("writing", 1.0);
    if (!options.output.empty()) {
      WriteMesh(mesh, lattice.OnLattice(volume->metadata().WorldFromIndex()), options.output,
                if_there);
    }
  }
  Print(statistics, seconds);
  return 0;
}

}  // namespace palpate::lab
