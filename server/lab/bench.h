// palpate-lab bench: judges and times the fixed slides.
//
// Each slide has 60 000 ticks, 1.0 ± 0.2 mm below the surface at 0.5 N/mm. The volumes are
// computed, not loaded, so that results from different machines or versions are comparable.
// Threads: the calling one; H is extracted on all cores. Errors: Error.
#pragma once

#include <array>
#include <iosfwd>

#include "server/lab/replay_command.h"

namespace palpate::lab {

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

}  // namespace palpate::lab
