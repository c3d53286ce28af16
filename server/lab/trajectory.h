// Trajectories of the HIP over the surface of a volume, one position a
// millisecond, made up but the same on every run.
//
//   slide     1.0 ± 0.2 mm below V, at a given speed
//   freehand  5 to 19 cm/s, now below and now above V, as the paper's users did
//   random    steps of all sizes, jumps, far positions and some that are none: an attack
// Slides start outside of the object and press in; where a walk gets stuck the HIP
// jumps elsewhere and presses in anew.
//
// Frame: W, the volume's world (mm). Threads: any ordinary thread. Errors: Error.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "server/volume/snapshot.h"

namespace palpate::lab {

enum class TrajectoryKind : std::uint8_t { kSlide, kFreehand, kRandom };

inline constexpr std::array<std::string_view, 3> kTrajectoryNames = {"slide", "freehand", "random"};
std::optional<TrajectoryKind> TrajectoryNamed(std::string_view name);

struct TrajectoryRequest {
  TrajectoryKind kind = TrajectoryKind::kSlide;
  double isovalue = 0.5;         // normalised
  double speed_cm_per_s = 10.0;  // of slides
  int ticks = 60'000;
  std::uint64_t seed = 1;
};

std::vector<Vec3> MakeTrajectory(const VolumeSnapshot& volume, const TrajectoryRequest& request);

}  // namespace palpate::lab
