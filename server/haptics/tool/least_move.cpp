#include "server/haptics/tool/least_move.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

// Two rows depend on each other where the part across them is shorter than this share (squared).
constexpr double kDependent2 = 1e-10;

// The active limits, with an orthonormal base of their rows.
class ActiveSet {
 public:
  int count() const { return count_; }
  int limit(int n) const { return limit_[n]; }
  double& force(int n) { return force_[n]; }

  // The part of `row` across the active rows; `shares`: of the active rows in the rest.
  Vec6 Across(const Vec6& row, std::array<double, 6>& shares) const {
    Vec6 across = row;
    std::array<double, 6> along{};
    for (int n = 0; n < count_; ++n) {
      along[n] = base_[n].dot(across);
      across -= along[n] * base_[n];
    }
    for (int n = count_ - 1; n >= 0; --n) {
      double sum = along[n];
      for (int m = n + 1; m < count_; ++m) sum -= triangle_[n][m] * shares[m];
      shares[n] = sum / triangle_[n][n];
    }
    return across;
  }

  void Add(int limit, const Vec6& row, double force) {
    limit_[count_] = limit;
    force_[count_] = force;
    row_[count_] = row;
    ++count_;
    Orthogonalize(count_ - 1);
  }

  void Remove(int n) {
    for (int m = n + 1; m < count_; ++m) {
      limit_[m - 1] = limit_[m];
      force_[m - 1] = force_[m];
      row_[m - 1] = row_[m];
    }
    --count_;
    for (int m = n; m < count_; ++m) Orthogonalize(m);
  }

 private:
  void Orthogonalize(int n) {
    Vec6 across = row_[n];
    for (int m = 0; m < n; ++m) {
      triangle_[m][n] = base_[m].dot(across);
      across -= triangle_[m][n] * base_[m];
    }
    triangle_[n][n] = across.norm();
    base_[n] = across / triangle_[n][n];
  }

  int count_ = 0;
  std::array<int, 6> limit_{};
  std::array<double, 6> force_{};
  std::array<Vec6, 6> row_, base_;
  std::array<std::array<double, 6>, 6> triangle_{};
};

constexpr double kNever = std::numeric_limits<double>::infinity();

// Makes x hold one more limit. Returns false if it cannot, with the active ones.
bool Hold(int number, const MoveLimit& limit, ActiveSet& active, Vec6& x) {
  double force = 0.0;
  for (;;) {
    std::array<double, 6> shares{};
    const Vec6 across = active.Across(limit.along, shares);
    // The force at which an active limit lets go.
    double until = kNever;
    int first = -1;
    for (int n = 0; n < active.count(); ++n) {
      if (!(shares[n] > 0.0) || active.force(n) >= until * shares[n]) continue;
      until = active.force(n) / shares[n];
      first = n;
    }
    const double across2 = across.squaredNorm();
    const bool depends = active.count() == 6 || across2 <= kDependent2 * limit.along.squaredNorm();
    const double enough = depends ? kNever : (limit.least - limit.along.dot(x)) / across2;
    const double step = std::min(until, enough);
    if (step == kNever) return false;
    if (!depends) x += step * across;
    for (int n = 0; n < active.count(); ++n) active.force(n) -= step * shares[n];
    force += step;
    if (enough <= until) {
      active.Add(number, limit.along, force);
      return true;
    }
    active.Remove(first);
  }
}

}  // namespace

LeastMove NearestMove(const Vec6& wanted, std::span<const MoveLimit> limits, double tolerance,
                      int most_steps) noexcept {
  LeastMove move{.x = wanted};
  ActiveSet active;
  while (move.steps < most_steps) {
    ++move.steps;
    int worst = -1;
    double worst_lack = tolerance;
    for (std::size_t n = 0; n < limits.size(); ++n) {
      const double lack = limits[n].least - limits[n].along.dot(move.x);
      if (lack > worst_lack) worst_lack = lack, worst = static_cast<int>(n);
    }
    if (worst < 0) break;
    const MoveLimit& limit = limits[static_cast<std::size_t>(worst)];
    move.feasible = Hold(worst, limit, active, move.x);
    if (!move.feasible) return move;
  }
  move.active_count = active.count();
  for (int n = 0; n < active.count(); ++n) move.active[n] = active.limit(n);
  return move;
}

}  // namespace palpate
