// Makes trajectories of the HIP over the surface of a volume, one position per millisecond. The
// trajectory is random but the same on every run.
//
//   slide     1.0 ± 0.2 mm below V, at a given speed
//   freehand  5 to 19 cm/s, sometimes below and sometimes above V, like the paper's users
//   random    an attack: steps of all sizes, jumps, far positions, positions that are not finite
// Slides start outside of the object and press in. If a walk gets stuck, the HIP jumps elsewhere
// and presses in again.
//
// Frame: W, the volume's world (mm). Threads: any ordinary thread. Errors: Error.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "server/volume/snapshot/snapshot.h"

namespace palpate::lab {

enum class TrajectoryKind : std::uint8_t { kSlide, kFreehand, kRandom };

inline constexpr std::array<std::string_view, 3> kTrajectoryNames = {"slide", "freehand", "random"};
std::optional<TrajectoryKind> TrajectoryNamed(std::string_view name);

struct TrajectoryRequest {
  TrajectoryKind kind = TrajectoryKind::kSlide;
  double isovalue = 0.5;         // normalised
  double speed_cm_per_s = 10.0;  // only for slides
  int ticks = 60'000;
  std::uint64_t seed = 1;
};

std::vector<Vec3> MakeTrajectory(const VolumeSnapshot& volume, const TrajectoryRequest& request);

}  // namespace palpate::lab
