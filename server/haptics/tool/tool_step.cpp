#include "server/haptics/tool/tool_step.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "server/haptics/tool/chord.h"

namespace palpate {
namespace {

constexpr double kStandoffMm = 1e-3;
constexpr double kStandoffVoxels = 0.01;
// Tetrahedra so near that a ball may have to do with them.
constexpr double kReachStandoffs = 4.0;
// Ridges that a ball at rest tries to go over: so near that the standoff alone, times the depth of
// a few mm, may lift the ball over them.
constexpr double kRidgeMm = 0.1;
constexpr double kRidgeVoxels = 0.25;
// Beyond a ridge, so many planes may hold a ball.
constexpr int kMostBeyond = 3;
// Shorter moves are rest, in standoffs.
constexpr double kRestStandoffs = 0.02;
// Turns use the standoff up: after so much progress, balls get it back.
constexpr double kRiseStandoffs = 20.0;
// The longest move of a ball in one round.
constexpr double kLongestWayVoxels = 8.0;
constexpr int kMostWayHalvings = 5;  // to a quarter of a voxel
constexpr double kLongestWayOutVoxels = 1.0;
// A nearest move may cost a quarter of the work.
constexpr int kMovesInWork = 4;
// After steps without a move, the tool is content with the planes of the tetrahedra that hold its
// balls, and with ever shorter moves: so there is work left for one.
constexpr int kMostStalledHalvings = 10;
constexpr double kLongestRoundTurnRad = 0.25;
constexpr int kMostTries = 12;
constexpr int kMostEjectSteps = 50;

struct Hit {
  int ball = -1;
  ChordHit chord;
};

double ShortestVoxel(const RigidTool& tool, const ToolSurfaces& surfaces) {
  double voxel_mm = std::numeric_limits<double>::infinity();
  for (int n = 0; n < tool.radius_count; ++n) {
    voxel_mm = std::min(voxel_mm, surfaces.surface[static_cast<std::size_t>(n)]->voxel_mm);
  }
  return voxel_mm;
}

class Stepper {
 public:
  Stepper(const RigidTool& tool, const ToolSurfaces& surfaces, const ToolPose& stylus, int work,
          double eject_limit_mm, ToolState& state, ToolPath* path)
      : tool_(tool),
        surfaces_(surfaces),
        stylus_(stylus),
        most_work_(work),
        eject_limit_mm_(eject_limit_mm),
        rho_mm_(tool.rotation_length_mm),
        state_(state),
        path_(path),
        pose_(state.pose) {
    for (int n = 0; n < tool.radius_count; ++n) {
      const HapticSurface& surface = *surfaces.surface[static_cast<std::size_t>(n)];
      longest_voxel_mm_ = std::max(longest_voxel_mm_, surface.longest_voxel_mm);
    }
    // So short that all chords of a round fit into half the work.
    longest_way_mm_ = kLongestWayVoxels * voxel_mm_;
    for (int n = 0; n < kMostWayHalvings && 2 * tool.count * ChordWork() > work; ++n) {
      longest_way_mm_ *= 0.5;
    }
    if (state.stalled_steps > 0) reach_mm_ = 0.0;
    longest_way_mm_ = std::ldexp(longest_way_mm_, -state.stalled_steps);
    longest_way_out_mm_ = std::min(longest_way_mm_, kLongestWayOutVoxels * voxel_mm_);
    most_chord_work_ = ChordWork();
    for (int n = 0; n < tool.radius_count; ++n) {
      const HapticSurface& surface = *surfaces.surface[static_cast<std::size_t>(n)];
      most_look_work_ = std::max(most_look_work_, MostLookWork(surface, reach_mm_));
    }
  }

  ToolStep Run() noexcept {
    const ToolPose from = state_.pose;
    Place();
    if (!step_.capped) {
      state_.stalled_steps = 0;
    } else if (pose_.p_DS_mm == from.p_DS_mm && pose_.R_DS.coeffs() == from.R_DS.coeffs()) {
      state_.stalled_steps = std::min(state_.stalled_steps + 1, kMostStalledHalvings);
    }
    step_.pose = pose_;
    state_.pose = pose_;
    return step_;
  }

 private:
  int ChordWork() const {
    int most = 0;
    for (int n = 0; n < tool_.radius_count; ++n) {
      most = std::max(
          most, MostChordWork(*surfaces_.surface[static_cast<std::size_t>(n)], longest_way_mm_));
    }
    return most;
  }

  // --- Poses

  void SetPose(const ToolPose& pose) noexcept {
    pose_ = pose;
    const Mat3 R = pose.R_DS.toRotationMatrix();
    for (int n = 0; n < tool_.count; ++n) {
      balls_.arm_mm[n] = R * tool_.ball[n].p_SBall_mm;
      balls_.p_mm[n] = pose.p_DS_mm + balls_.arm_mm[n];
    }
    is_looked_ = false;
  }

  const HapticSurface& SurfaceOf(int ball) const {
    return *surfaces_.surface[tool_.ball[ball].radius];
  }
  ToolCellCache& CacheOf(int ball) const { return *surfaces_.cache[tool_.ball[ball].radius]; }

  // In the metric of the coupling.
  Vec6 Metric(const ToolMove& move) const {
    Vec6 x;
    x << move.way_mm, rho_mm_ * move.turn_rad;
    return x;
  }
  ToolMove Plain(const Vec6& x) const { return {x.head<3>(), x.tail<3>() / rho_mm_}; }
  Vec6 Wanted() const { return Metric(MoveBetween(pose_, stylus_)); }

  // The share of a move that a round may go.
  double ShareOfRound(const ToolMove& move) const {
    const double longest_mm = inside_ == 0 ? longest_way_mm_ : longest_way_out_mm_;
    return std::min(
        {1.0, longest_mm / LongestWay(move), kLongestRoundTurnRad / move.turn_rad.norm()});
  }

  // --- What is around the balls

  void Look() noexcept {
    if (is_looked_) return;
    is_looked_ = true;
    planes_.ForgetNear();
    inside_ = 0;
    for (int n = 0; n < tool_.count; ++n) LookFrom(n);
    planes_.DropKept();
  }

  // Whether there is room for so much more work.
  bool MayWork(int most) {
    step_.capped = step_.capped || step_.work + most > most_work_;
    return !step_.capped;
  }

  void LookFrom(int n) noexcept {
    balls_.excess[n] = 0.0;
    if (!MayWork(most_look_work_)) return;
    palpate::Look(SurfaceOf(n), balls_.p_mm[n], reach_mm_, CacheOf(n), around_, step_.work);
    balls_.excess[n] = around_.excess;
    if (around_.excess > 0.5 * kDensityMargin) inside_ |= std::uint64_t{1} << n;
    for (int i = 0; i < around_.count; ++i) {
      planes_.AddNear({n, around_.plane[static_cast<std::size_t>(i)]});
    }
  }

  // The nearest move in the planes at hand.
  Vec6 Solve(const Vec6& wanted, Limits limits, std::span<const BallPlane> beyond = {}) noexcept {
    const int work = std::min(most_work_ - step_.work, most_work_ / kMovesInWork);
    held_ = planes_.Solve(wanted, limits, beyond, work, step_.work, step_.capped);
    return held_.x;
  }

  // --- Moves

  // The first hit on the way to a pose; its ball is -1 where there is none.
  Hit Verify(const ToolPose& to) noexcept {
    const Mat3 R = to.R_DS.toRotationMatrix();
    Hit first;
    for (int n = 0; n < tool_.count; ++n) {
      next_mm_[n] = to.p_DS_mm + R * tool_.ball[n].p_SBall_mm;
      if (inside_ >> n & 1) continue;
      if (!MayWork(most_chord_work_)) return first;
      const auto hit = FirstHit(SurfaceOf(n), balls_.p_mm[n], next_mm_[n], CacheOf(n), step_.work);
      if (hit && (first.ball < 0 || hit->share < first.chord.share)) first = {n, *hit};
    }
    return first;
  }

  // Of a ball, at most: what the first order leaves out is shorter than the second term.
  double LongestWay(const ToolMove& move) const {
    const double turn2 = move.turn_rad.squaredNorm();
    double longest_mm = 0.0;
    for (int n = 0; n < tool_.count; ++n) {
      longest_mm =
          std::max(longest_mm, (move.way_mm + move.turn_rad.cross(balls_.arm_mm[n])).norm() +
                                   0.5 * turn2 * balls_.arm_mm[n].norm());
    }
    return longest_mm;
  }

  enum class End : std::uint8_t { kMoved, kNewPlane, kBlocked };

  // Goes as far along `x` as the chords are free. kNewPlane: there is one more plane to hold.
  End Follow(const Vec6& x, bool to_stylus, bool may_resolve) noexcept {
    ToolMove move = Plain(x);
    const double share = ShareOfRound(move);
    if (share < 1.0) move = move * share, to_stylus = false;
    End end = End::kBlocked;
    for (int tries = 0; tries < kMostTries; ++tries) {
      const ToolPose to = to_stylus ? stylus_ : Moved(pose_, move);
      const Hit hit = Verify(to);
      if (step_.capped) return End::kBlocked;
      if (hit.ball < 0) {
        SetPose(to);
        may_rise_ = false;
        if (path_ != nullptr) path_->pose[static_cast<std::size_t>(path_->count++)] = to;
        return End::kMoved;
      }
      to_stylus = false;
      double left = 0.5 * hit.chord.share;
      if (hit.chord.plane) {
        const BallPlane met{hit.ball, *hit.chord.plane};
        const double from_mm = met.plane.Gap(balls_.p_mm[met.ball]);
        const double to_mm = met.plane.Gap(next_mm_[met.ball]);
        left = 0.5;
        if (!planes_.Knows(met)) {
          planes_.Keep(met);
          end = End::kNewPlane;
          if (may_resolve && planes_.Holds(met)) return end;
          left = std::clamp((from_mm - standoff_mm_) / (from_mm - to_mm), 0.0, hit.chord.share);
        }
      }
      move = move * left;
      if (LongestWay(move) < standoff_mm_) return end;
    }
    return end;
  }

  // --- The step

  bool IsRest(const Vec6& x) const { return x.norm() <= kRestStandoffs * standoff_mm_; }

  void Place() noexcept {
    const std::uint64_t loaded = surfaces_.surface[0]->volume->loaded_revision();
    // Nobody asked for a push where a hand happens to be in another volume, but for as much as
    // another lattice may need.
    if (state_.placed && loaded != state_.loaded_revision) {
      eject_limit_mm_ = std::min(eject_limit_mm_, longest_voxel_mm_);
    }
    state_.loaded_revision = loaded;
    const bool is_held = state_.placed && !state_.buried;
    SetPose(is_held ? pose_ : stylus_);
    Look();
    if (inside_ != 0 && is_held) {
      step_.mode = ProxyMode::kEjecting;
      const bool is_out = Eject();
      if (step_.capped && ++state_.ejecting_steps < kMostEjectSteps) {
        state_.placed = true;
        return;
      }
      if (!is_out) inside_ = 1;
    }
    state_.ejecting_steps = 0;
    state_.ejected_mm = 0.0;
    state_.placed = true;
    state_.buried = inside_ != 0;
    if (!state_.buried) return is_held ? AdvanceOrStay() : Advance();
    step_.mode = ProxyMode::kInside;
    SetPose(stylus_);
  }

  // Moves the tool by as little as brings all balls out, down the densities. Returns false if that
  // is too far, or no way out is found.
  bool Eject() noexcept {
    const ToolPose from = pose_;
    const double before_mm = state_.ejected_mm;
    while (inside_ != 0 && step_.rounds < kMostToolRounds) {
      ++step_.rounds;
      End end = End::kNewPlane;
      for (int n = 0; n < kMostTries && end == End::kNewPlane; ++n) {
        const Vec6 x = Solve(Vec6::Zero(), Limits::kRestore);
        if (IsRest(x)) return false;
        end = Follow(x, false, true);
      }
      if (end != End::kMoved) return false;
      state_.ejected_mm = before_mm + Metric(MoveBetween(from, pose_)).norm();
      if (state_.ejected_mm > eject_limit_mm_) return false;
      Look();
      if (step_.capped) return false;
    }
    return inside_ == 0;
  }

  // A step that does not come nearer stays: giving standoffs back would let a resting tool hop.
  void AdvanceOrStay() noexcept {
    const ToolPose from = pose_;
    const double distance = Wanted().norm();
    Advance();
    if (step_.capped || distance - Wanted().norm() > kRestStandoffs * standoff_mm_) return;
    SetPose(from);
    if (path_ != nullptr) path_->count = 0;
  }

  void Advance() noexcept {
    bool is_sure = false;  // rest was looked for with the planes around the balls alone, and here
    while (step_.rounds < kMostToolRounds) {
      ++step_.rounds;
      Look();
      if (step_.capped) return Rest();
      const Vec6 wanted = Wanted();
      if (wanted.norm() < risen_at_ - kRiseStandoffs * standoff_mm_) may_rise_ = true;
      if (may_rise_) risen_at_ = wanted.norm();
      Vec6 x = Next(wanted);
      if (step_.capped) return Rest();
      if (IsRest(x)) {
        if (!planes_.kept().empty() && !is_sure) {
          planes_.ForgetKept();
          is_sure = true;
          continue;
        }
        if (!GoOverRidge(wanted)) return Rest();
        continue;
      }
      End end = End::kBlocked;
      for (int n = 0; n < kMostTries; ++n) {
        end = Follow(x, held_.active_count == 0 && !is_cut_, n < 4);
        if (end != End::kNewPlane) break;
        x = Next(wanted);
        if (IsRest(x)) break;
      }
      if (step_.capped || end == End::kBlocked) return Rest();
      if (end == End::kMoved) is_sure = false;
    }
    step_.capped = true;
    Rest();
  }

  // A move that is too long for a round is cut, but not its part that gives standoffs back.
  Vec6 Next(const Vec6& wanted) noexcept {
    const Vec6 x = Solve(wanted, may_rise_ ? Limits::kRestore : Limits::kKeep);
    const double share = ShareOfRound(Plain(x));
    is_cut_ = may_rise_ && held_.active_count > 0 && share < 1.0;
    return is_cut_ ? Solve(share * wanted, Limits::kRestore) : x;
  }

  // Returns true if the tool could come nearer beyond a ridge.
  bool GoOverRidge(const Vec6& wanted) noexcept {
    const HeldMove holding = held_;
    for (std::uint64_t left = holding.active; left != 0; left &= left - 1) {
      const int ball = std::countr_zero(left);
      if (GoOverRidgeOf(ball, wanted)) return true;
      if (step_.capped) break;
    }
    held_ = holding;
    return false;
  }

  bool GoOverRidgeOf(int ball, const Vec6& wanted) noexcept {
    const double reach_mm = std::min(kRidgeMm, kRidgeVoxels * SurfaceOf(ball).voxel_mm);
    if (!MayWork(MostLookWork(SurfaceOf(ball), reach_mm))) return false;
    palpate::Look(SurfaceOf(ball), balls_.p_mm[ball], reach_mm, CacheOf(ball), around_, step_.work);
    for (int n = 0; n < around_.count && !step_.capped; ++n) {
      const BallPlane ridge{ball, around_.plane[static_cast<std::size_t>(n)]};
      if (!planes_.Holds(ridge) && GoOver(ridge, wanted)) return true;
    }
    return false;
  }

  // Goes to the ridge with what room the standoff gives, and on along the plane beyond it.
  bool GoOver(const BallPlane& ridge, const Vec6& wanted) noexcept {
    const double before = wanted.norm();
    const double least_gain = std::max(2.0 * standoff_mm_, 1e-3 * before);
    const auto gain = [&](const Vec6& x) { return before - (wanted - x).norm(); };
    List<BallPlane, kMostBeyond> beyond;
    beyond.Add(ridge);
    if (gain(Solve(wanted, Limits::kBeyond, beyond.all())) < least_gain) return false;
    const Vec6 across = Solve(wanted, Limits::kAcross, beyond.all());
    if (!(gain(across) > 0.0) || !IsFree(ridge.ball, across)) return false;
    const ToolPose from = pose_;
    const int path_count = path_ != nullptr ? path_->count : 0;
    if (Follow(across, false, false) != End::kMoved) return false;
    for (int n = 0; n < kMostBeyond; ++n) {
      const std::size_t known = planes_.kept().size();
      const End end = Follow(Solve(Wanted(), Limits::kBeyond, beyond.all()), false, false);
      if (end == End::kMoved && before - Wanted().norm() >= least_gain) return true;
      if (end != End::kNewPlane || planes_.kept().size() == known) break;
      const BallPlane& met = planes_.kept()[known];
      if (met.ball != ridge.ball) break;
      beyond.Add(met);
    }
    SetPose(from);
    if (path_ != nullptr) path_->count = path_count;
    return false;
  }

  // Whether a single ball could go so far.
  bool IsFree(int ball, const Vec6& x) noexcept {
    const ToolMove move = Plain(x);
    if (move.turn_rad.norm() > kLongestRoundTurnRad || LongestWay(move) > longest_way_mm_ ||
        !MayWork(most_chord_work_)) {
      return false;
    }
    const ToolPose to = Moved(pose_, move);
    const Vec3 to_mm = to.p_DS_mm + to.R_DS * tool_.ball[ball].p_SBall_mm;
    return !FirstHit(SurfaceOf(ball), balls_.p_mm[ball], to_mm, CacheOf(ball), step_.work);
  }

  void Rest() noexcept {
    step_.touching = held_.active;
    if (held_.active != 0) step_.slope_per_mm = held_.slope_per_mm;
    if (step_.mode == ProxyMode::kEjecting) return;
    step_.mode = held_.active != 0 ? ProxyMode::kConstrained : ProxyMode::kFree;
  }

  const RigidTool& tool_;
  const ToolSurfaces& surfaces_;
  const ToolPose& stylus_;
  const int most_work_;
  double eject_limit_mm_;
  const double rho_mm_;
  ToolState& state_;
  ToolPath* path_;
  ToolPose pose_;
  const double voxel_mm_ = ShortestVoxel(tool_, surfaces_);
  double longest_voxel_mm_ = 0.0;
  const double standoff_mm_ = std::min(kStandoffMm, kStandoffVoxels* voxel_mm_);
  double reach_mm_ = kReachStandoffs * standoff_mm_;
  double longest_way_mm_ = 0.0;  // of a ball in a round
  double longest_way_out_mm_ = 0.0;
  int most_chord_work_ = 0, most_look_work_ = 0;
  ToolStep step_;

  PlacedBalls balls_;
  std::array<Vec3, kMostToolBalls> next_mm_;
  bool is_looked_ = false;
  // The first move of a step gives the balls their standoff back, and so does one after more
  // progress than that costs. Else the energy only falls: so a step ends, and the next one of a
  // resting hand is the same.
  bool may_rise_ = true;
  double risen_at_ = std::numeric_limits<double>::infinity();  // so far from the stylus
  std::uint64_t inside_ = 0;
  Surroundings around_;
  BallPlanes planes_{balls_, standoff_mm_, rho_mm_};
  HeldMove held_;
  bool is_cut_ = false;  // the move is one to a nearer goal than the stylus
};

}  // namespace

ToolStep StepTool(const RigidTool& tool, const ToolSurfaces& surfaces, const ToolPose& stylus,
                  double eject_limit_mm, int work, ToolState& state, ToolPath* path) noexcept {
  return Stepper(tool, surfaces, stylus, work, eject_limit_mm, state, path).Run();
}

}  // namespace palpate
