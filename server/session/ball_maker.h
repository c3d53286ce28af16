// Makes the fields of balls (felt_surface.h) in the background: always the newest that is wanted. What
// is no longer wanted is given up.
//
// Threads: a thread of its own, beside everybody's work. Errors: a field that cannot be made is
// logged and told by problem(); what was felt before stays.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "server/felt/felt_surface.h"
#include "server/live_volume/memory_budget.h"

namespace palpate {

// Why a volume that lies so cannot have the balls of the settings' tip, for people; empty: it can.
std::string RefusalOfTip(const HapticSettings& settings, const AffineMap& X_DI);

// In messages about memory.
inline constexpr char kBallInMessages[] = "the field of the ball at the tip";

// Claims the most memory that a ball's field takes. Throws Error (kTooLarge).
MemoryClaim ClaimFor(const Ball& ball, const VolumeSnapshot& volume, MemoryBudget& budget);

// Makes a field within the budget. Throws Error (kTooLarge), and what `progress` throws.
FeltBall MakeFeltBall(const Ball& ball, const VolumeSnapshot& volume, MemoryBudget& budget,
                      const std::function<void(double share)>& progress);

class BallMaker {
 public:
  struct Wanted {
    Ball ball;
    std::shared_ptr<const VolumeSnapshot> volume;
  };

  // `wanted`: what to make; none: nothing. `take`: gets what was made. Both are called on the
  // thread, without a lock. `take` returns false if the ball is not wanted any more.
  BallMaker(std::shared_ptr<MemoryBudget> budget, std::function<std::optional<Wanted>()> wanted,
            std::function<bool(FeltBall)> take);
  ~BallMaker();
  BallMaker(const BallMaker&) = delete;
  BallMaker& operator=(const BallMaker&) = delete;

  // Call it when another field may be wanted. Does not wait.
  void Wake();

  // The share of the field in the making that is done; none: nothing is being made.
  std::optional<double> share() const;
  // Why this field could not be made; empty: it was not tried, or is being made.
  std::string ProblemOf(const Wanted& wanted) const;
  // A field that could not be made is tried again with the next Wake.
  void ForgetProblem();

 private:
  struct GivenUp {};
  struct Failure {  // holds no voxels
    Ball ball;
    std::uint64_t loaded_revision = 0;
    std::string why;
    bool IsOf(const Wanted& wanted) const;
  };

  void Run();
  void Make(const Wanted& wanted);

  const std::shared_ptr<MemoryBudget> budget_;
  const std::function<std::optional<Wanted>()> wanted_;
  const std::function<bool(FeltBall)> take_;
  std::atomic<double> share_ = -1.0;
  std::atomic<bool> stop_ = false;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  bool is_awake_ = false;
  std::optional<Failure> failure_;  // is not tried again

  std::thread thread_;  // begins last
};

}  // namespace palpate
