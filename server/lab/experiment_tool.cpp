// Rigid tools of 1 to 64 points on a gyroid and a CT head: times, falls, rests and energy.
#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <memory>
#include <random>
#include <vector>

#include "common/error/error.h"
#include "server/haptics/tool/tool_renderer.h"
#include "server/lab/experiments.h"
#include "server/lab/lab_arguments.h"
#include "server/lab/proxy_judges.h"
#include "server/lab/replay.h"
#include "server/servo/tick_computation.h"

namespace palpate::lab {
namespace {

constexpr const char* kHeadOfTools = "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd";
constexpr int kTicksPerGoal = 150;
constexpr double kDeepestMm = 2.0, kMostTurnedRad = 0.2;  // of the hand beyond the tool
constexpr int kTicksPerPlace = 3000;                      // then the hand begins elsewhere
constexpr int kTicksPerRest = 20;
constexpr int kTeleportTicks = 50;

struct Ground {
  const char* name;
  const char* volume;
  double normalized_isovalue, mm_per_volume_mm, length_mm;
};
constexpr Ground kGrounds[] = {{"gyroid, 1 voxel/mm", "builtin:gyroid:64", 0.5, 1.0, 16.0},
                               {"gyroid, 3 voxels/mm", "builtin:gyroid:64", 0.5, 1.0 / 3, 16.0},
                               {"CT head, skin", kHeadOfTools, 0.17, 1.0, 60.0},
                               {"CT head, bone", kHeadOfTools, 0.33, 1.0, 60.0}};

struct Pace {
  double cm_per_s, rad_per_s;
  bool teleports = false;
};

// A line of balls; from 32 on half of them on a burr at its tip.
RigidTool ToolOf(int count, double length_mm, double rho_mm) {
  RigidTool tool;
  tool.count = count;
  tool.radius_count = 1;
  tool.rotation_length_mm = rho_mm;
  const int of_burr = count >= 32 ? count / 2 : 0, of_line = count - of_burr;
  const double burr_mm = length_mm / 20.0;
  for (int n = 0; n < of_burr; ++n) {
    const double z = 1.0 - (2.0 * n + 1.0) / of_burr, r = std::sqrt(1.0 - z * z);
    const double around = 2.399963 * n;
    tool.ball[static_cast<std::size_t>(n)].p_SBall_mm =
        burr_mm * Vec3(r * std::cos(around), r * std::sin(around), z);
  }
  for (int n = 1; n < of_line; ++n) {
    tool.ball[static_cast<std::size_t>(of_burr + n)].p_SBall_mm.z() = length_mm * n / (of_line - 1);
  }
  return tool;
}

struct Figures {
  std::vector<double> us;
  long contacts = 0, capped = 0, falls = 0, judged = 0, rests = 0, sticks = 0;
  double given_mj = 0.0, force_only_mj = 0.0;  // without the port's tank
  double capped_us = 0.0;                      // median
};

class Run {
 public:
  Run(const HapticSurface& surface, const RigidTool& tool, bool has_torque, std::uint64_t seed)
      : random_(seed), judge_(surface, felt_.tool) {
    felt_.tool = tool;
    felt_.surface[0] = surface;
    felt_.cache[0] = cache_.get();
    state_->device.max_torque_n_mm = has_torque ? 1e6 : 0.0;
    state_->device.max_force_n = 1e6;
  }

  Figures Do(const Pace& pace, int ticks, bool judges) {
    for (int n = 0; n < ticks; ++n) {
      if (n % kTicksPerPlace == 0) BeginSomewhere();
      MoveHand(pace, n);
      Tick(judges, n);
    }
    figures_.judged = judge_.judged();
    std::ranges::sort(figures_.us);
    std::ranges::sort(capped_us_);
    if (!capped_us_.empty()) figures_.capped_us = capped_us_[capped_us_.size() / 2];
    return figures_;
  }

 private:
  const HapticSurface& surface() const { return felt_.surface[0]; }
  Vec3 Vector() { return {normal_(random_), normal_(random_), normal_(random_)}; }
  Vec3 Direction() { return Vector().normalized(); }
  ToolPose Tool() const { return memory_.state.pose; }

  // In free space, next to the surface.
  void BeginSomewhere() {
    const Vec3 size = surface().volume->size().cast<double>();
    do {
      const Vec3 at_I = Vec3(uniform_(random_), uniform_(random_), uniform_(random_));
      hand_ = {surface().X_DI.Apply(at_I.cwiseProduct(size)),
               Eigen::Quaterniond(Eigen::AngleAxisd(3.14 * uniform_(random_), Direction()))};
      memory_ = ToolMemory();
      last_ = StepWithTool(felt_, settings_, hand_.p_DS_mm, hand_.R_DS, kReplayPeriodS, kToolWork,
                           *state_, memory_);
    } while (last_.tool.mode != ProxyMode::kFree || !GoToTheSurface());
    goal_ = hand_;
    given_mj_ = force_only_mj_ = 0.0;
  }

  // Straight on until the tool touches, and a step back. Returns false if it does not.
  bool GoToTheSurface() {
    const Vec3 step_mm = 0.5 * Direction();
    const auto go = [&](const Vec3& way_mm) {
      hand_.p_DS_mm += way_mm;
      last_ = StepWithTool(felt_, settings_, hand_.p_DS_mm, hand_.R_DS, kReplayPeriodS, kToolWork,
                           *state_, memory_);
      return last_.tool.touching != 0;
    };
    for (int n = 0; n < 400; ++n) {
      if (go(step_mm)) return !go(-2.0 * step_mm);
    }
    return false;
  }

  void MoveHand(const Pace& pace, int tick) {
    before_ = hand_;
    if (pace.teleports) {
      hand_ = Moved(hand_, {uniform_(random_) * Vector(), 0.05 * Vector()});
      if (tick % kTeleportTicks == 0)
        hand_ = Moved(hand_, {60.0 * Direction(), 0.49 * Direction()});
      return;
    }
    if (tick % kTicksPerGoal == 0) {
      const double turn_rad = 0.45 * uniform_(random_);
      goal_ =
          Moved(Tool(), {(0.5 + 9.0 * uniform_(random_)) * Direction(), turn_rad * Direction()});
    }
    // No hand presses harder, or is faster.
    const ToolPose wanted =
        Moved(Tool(), Limited(MoveBetween(Tool(), GoTo(goal_, pace)), kDeepestMm, kMostTurnedRad));
    hand_ = GoTo(wanted, pace);
  }
  ToolPose GoTo(const ToolPose& goal, const Pace& pace) const {
    return Moved(hand_, Limited(MoveBetween(hand_, goal), 10.0 * pace.cm_per_s * kReplayPeriodS,
                                pace.rad_per_s * kReplayPeriodS));
  }
  static ToolMove Limited(const ToolMove& move, double most_mm, double most_rad) {
    const double mm = move.way_mm.norm(), rad = move.turn_rad.norm();
    return {move.way_mm * (mm > most_mm ? most_mm / mm : 1.0),
            move.turn_rad * (rad > most_rad ? most_rad / rad : 1.0)};
  }

  void Tick(bool judges, int tick) {
    const ToolState from = memory_.state;
    if (judges) Judge(from);
    const double begin_us = ThreadUs();
    const ToolOutput output = StepWithTool(felt_, settings_, hand_.p_DS_mm, hand_.R_DS,
                                           kReplayPeriodS, kToolWork, *state_, memory_);
    const double us = ThreadUs() - begin_us;
    figures_.us.push_back(us);
    figures_.contacts += output.tool.touching != 0;
    figures_.capped += output.tool.capped;
    if (output.tool.capped) capped_us_.push_back(us);
    const bool rests = output.tool.mode == ProxyMode::kConstrained && !output.tool.capped;
    if (judges && rests && tick % kTicksPerRest == 0) JudgeRest(output.tool.pose);
    Account(output);
  }

  // The same step again, with its ways.
  void Judge(ToolState from) {
    if (!from.placed || from.buried) return;
    ToolSurfaces surfaces;
    surfaces.surface[0] = &surface();
    surfaces.cache[0] = cache_.get();
    const ToolPose begin = from.pose;
    ToolPath path;
    StepTool(felt_.tool, surfaces, {hand_.p_DS_mm, hand_.R_DS.normalized()}, 1e9, kToolWork, from,
             &path);
    figures_.falls += judge_.Falls(begin, path);
  }

  void JudgeRest(const ToolPose& rest) {
    ++figures_.rests;
    const double nearer_mm = judge_.NearerBySearch(random_, rest, hand_);
    figures_.sticks += nearer_mm > 0.01 + 0.01 * judge_.Distance(rest, hand_);
  }

  // By the mean of two forces.
  void Account(const ToolOutput& output) {
    const ToolMove moved = MoveBetween(before_, hand_);
    given_mj_ += 0.5 * (output.haptic.force_D_n + last_.haptic.force_D_n).dot(moved.way_mm) +
                 0.5 * (output.torque_D_n_mm + last_.torque_D_n_mm).dot(moved.turn_rad);
    force_only_mj_ += 0.5 * (output.haptic.spring_D_n + last_.haptic.spring_D_n).dot(moved.way_mm);
    figures_.given_mj = std::max(figures_.given_mj, given_mj_);
    figures_.force_only_mj = std::max(figures_.force_only_mj, force_only_mj_);
    last_ = output;
  }

  static double ThreadUs() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
  }

  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> uniform_;
  FeltTool felt_;
  HapticSettings settings_{.stiffness_n_per_mm = 1.0};
  std::unique_ptr<ToolCellCache> cache_ = std::make_unique<ToolCellCache>();
  std::unique_ptr<RendererState> state_ = std::make_unique<RendererState>();
  ToolJudge judge_;
  ToolPose hand_, before_, goal_;
  ToolOutput last_;
  ToolMemory memory_;
  double given_mj_ = 0.0, force_only_mj_ = 0.0;
  Figures figures_;
  std::vector<double> capped_us_;
};

double At(const std::vector<double>& sorted, double share) {
  const auto last = static_cast<double>(sorted.size() - 1);
  return sorted[static_cast<std::size_t>(share * last)];
}

void PrintRow(const char* what, int count, const Pace& pace, const Figures& f, std::ostream& out) {
  double mean_us = 0.0;
  for (const double us : f.us) mean_us += us / static_cast<double>(f.us.size());
  const std::string motion =
      pace.teleports ? "teleports" : std::to_string(static_cast<int>(pace.cm_per_s)) + " cm/s";
  Print(out, "%-20s %3d %-10s %5.1f%% %7.1f %7.1f %7.1f %6ld %7.0f %5ld %11ld %4ld %6ld %8.4f\n",
        what, count, motion.c_str(),
        100.0 * static_cast<double>(f.contacts) / static_cast<double>(f.us.size()), mean_us,
        At(f.us, 0.99), f.us.back(), f.capped, f.capped_us, f.falls, f.judged, f.sticks, f.rests,
        f.given_mj);
  out.flush();
}

}  // namespace

void PrintTool(const ExperimentOptions& options, std::ostream& out) {
  const int ticks = static_cast<int>(options.cells);
  Print(out, "%-20s %3s %-10s %6s %7s %7s %7s %6s %7s %5s %11s %4s %6s %8s\n", "", "N", "hand",
        "felt", "mean us", "p99 us", "max us", "capped", "its us", "falls", "of", "stuck", "of",
        "given mJ");
  long falls = 0, judged = 0, sticks = 0, rests = 0;
  for (const Ground& ground : kGrounds) {
    const bool is_file = ground.volume == kHeadOfTools;
    const std::filesystem::path source = options.data_folder / ground.volume;
    if (is_file && !std::filesystem::exists(source)) {
      throw Error(ErrorKind::kNotFound,
                  source.string() + " is not there: give its folder with --data");
    }
    const auto volume =
        LoadVolume(is_file ? source.string() : ground.volume, ImportProgramBesideThis());
    AffineMap X_DI = volume->metadata().WorldFromIndex();
    X_DI.linear *= ground.mm_per_volume_mm;
    X_DI.translation = -(X_DI.linear * (0.5 * volume->size().cast<double>()));
    const HapticSurface surface =
        MakeHapticSurface(*volume, X_DI, ground.normalized_isovalue, DecompositionMethod::kTpbcc, 1,
                          FreeSide::kBelow, options.refinement);
    for (const int count : {1, 8, 32, 64}) {
      for (const Pace& pace : {Pace{10.0, 2.0}, Pace{50.0, 10.0}, Pace{0.0, 0.0, true}}) {
        Run run(surface, ToolOf(count, ground.length_mm, 30.0), true, options.seed);
        const Figures figures = run.Do(pace, pace.teleports ? ticks / 10 : ticks, true);
        PrintRow(ground.name, count, pace, figures, out);
        falls += figures.falls, judged += figures.judged;
        sticks += figures.sticks, rests += figures.rests;
      }
    }
    Print(out, "without torque, N = 8, 60 mm, 10 cm/s: rho mm, given mJ, without the tank mJ:");
    for (const double rho_mm : {10.0, 30.0, 100.0, 300.0}) {
      Run run(surface, ToolOf(8, 60.0, rho_mm), false, options.seed);
      const Figures figures = run.Do({10.0, 2.0}, 20'000, false);
      Print(out, "  %.0f: %.4f, %.1f;", rho_mm, figures.given_mj, figures.force_only_mj);
    }
    out << "\n";
  }
  Print(out, "%ld falls in %ld points, %ld sticks in %ld rests\n", falls, judged, sticks, rests);
}

}  // namespace palpate::lab
