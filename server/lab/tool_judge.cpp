#include "server/lab/tool_judge.h"

#include <cmath>

namespace palpate::lab {
namespace {

constexpr int kTries = 600;
constexpr double kLongestTryMm = 0.2;
constexpr double kLeastGainMm = 0.002;  // twice the standoff

}  // namespace

bool ToolJudge::IsFree(const Vec3& p_mm) {
  return cells_.IsFree(cells_.HoldersOf(cells_.surface().X_LD.Apply(p_mm)).Density());
}

int ToolJudge::Falls(const ToolPose& from, const ToolPose& to) {
  cells_.Trim();
  int falls = 0;
  for (int n = 0; n < tool_.count; ++n) {
    const Vec3 a = BallAt(tool_, from, n), b = BallAt(tool_, to, n);
    for (int k = 1; k <= kPoints; ++k) falls += !IsFree(a + (b - a) * (1.0 * k / kPoints));
  }
  judged_ += static_cast<long>(tool_.count) * kPoints;
  return falls;
}

int ToolJudge::Falls(const ToolPose& from, const ToolPath& path) {
  int falls = 0;
  ToolPose last = from;
  for (int n = 0; n < path.count; ++n) {
    falls += Falls(last, path.pose[static_cast<std::size_t>(n)]);
    last = path.pose[static_cast<std::size_t>(n)];
  }
  return falls;
}

bool ToolJudge::IsFreeWay(const ToolPose& from, const ToolPose& to) {
  for (int n = 0; n < tool_.count; ++n) {
    const Vec3 a = BallAt(tool_, from, n), b = BallAt(tool_, to, n);
    for (int k = kPoints; k >= 1; --k) {  // the end is the likeliest to be blocked
      if (!IsFree(a + (b - a) * (1.0 * k / kPoints))) return false;
    }
  }
  return true;
}

double ToolJudge::Distance(const ToolPose& pose, const ToolPose& stylus) const {
  const Eigen::AngleAxisd turn(stylus.R_DS * pose.R_DS.conjugate());
  return std::hypot((stylus.p_DS_mm - pose.p_DS_mm).norm(),
                    tool_.rotation_length_mm * turn.angle());
}

double ToolJudge::NearerBySearch(std::mt19937_64& random, const ToolPose& rest,
                                 const ToolPose& stylus) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const auto vector = [&] { return Vec3(normal(random), normal(random), normal(random)); };
  cells_.Trim();
  ToolPose at = rest;
  double left_mm = Distance(rest, stylus);
  for (int n = 0; n < kTries; ++n) {
    const double size_mm = kLongestTryMm * std::pow(10.0, -3.0 * uniform(random));
    const double back = 0.02 * uniform(random);
    const Vec3 turn_rad = size_mm / tool_.rotation_length_mm * vector();
    ToolPose next{at.p_DS_mm + size_mm * vector() + back * (stylus.p_DS_mm - at.p_DS_mm),
                  Eigen::AngleAxisd(turn_rad.norm(), turn_rad.normalized()) * at.R_DS};
    next.R_DS = next.R_DS.slerp(back, stylus.R_DS);
    if (Distance(next, stylus) > left_mm - kLeastGainMm || !IsFreeWay(at, next)) continue;
    at = next;
    left_mm = Distance(at, stylus);
  }
  return Distance(rest, stylus) - left_mm;
}

}  // namespace palpate::lab
