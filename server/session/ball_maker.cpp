#include "server/session/ball_maker.h"

#include <pthread.h>

#include <algorithm>
#include <exception>
#include <utility>
#include <vector>

#include "common/felt_tool/tool_size.h"
#include "server/log/log.h"
#include "server/realtime/thread_setup.h"

namespace palpate {
namespace {

constexpr int kNice = 10;

}  // namespace

std::string RefusalOfTip(const HapticSettings& settings, const AffineMap& X_DI) {
  const std::vector<Ball> fields = FieldsOf(settings, X_DI);
  const auto ball = std::ranges::find_if_not(fields, CanBe);
  if (ball == fields.end()) return {};
  const auto [low, high] = BallRange(X_DI.linear);
  const std::string why = fmt::format(
      "a ball of {:g} mm cannot be felt here: its radius can be {:.4g} to {:.4g} mm ({:g} to {:g} "
      "voxels of the shortest edge)",
      // Rounded inwards.
      ball->radius_mm, 1.0005 * low, 0.9995 * high, kLeastBallVoxels, kMostBallVoxels);
  const auto scale = FittingScale(settings.tool, low / kLeastBallVoxels);
  if (settings.tool.ball.empty() || !scale) return why;
  return fmt::format("{}; at {:g} times this size the tool can", why, *scale);
}

MemoryClaim ClaimFor(const Ball& ball, const VolumeSnapshot& volume, MemoryBudget& budget) {
  return budget.Claim(kBallInMessages, FeltBall::MostBytes(ball, volume));
}

// The claim shrinks as bricks are made, so that they are not counted twice for long.
FeltBall MakeFeltBall(const Ball& ball, const VolumeSnapshot& volume, MemoryBudget& budget,
                      const std::function<void(double share)>& progress) {
  MemoryClaim claim = ClaimFor(ball, volume, budget);
  const auto most_bytes = static_cast<double>(claim.bytes());
  return FeltBall(ball, volume, [&](double share) {
    claim.Resize(static_cast<std::uint64_t>((1.0 - share) * most_bytes));
    progress(share);
  });
}

BallMaker::BallMaker(std::shared_ptr<MemoryBudget> budget,
                     std::function<std::optional<Wanted>()> wanted,
                     std::function<bool(FeltBall)> take)
    : budget_(std::move(budget)),
      wanted_(std::move(wanted)),
      take_(std::move(take)),
      thread_([this] { Run(); }) {}

BallMaker::~BallMaker() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void BallMaker::Wake() {
  {
    const std::lock_guard lock(mutex_);
    is_awake_ = true;
  }
  wake_.notify_all();
}

std::optional<double> BallMaker::share() const {
  const double share = share_;
  return share < 0.0 ? std::nullopt : std::optional(share);
}

bool BallMaker::Failure::IsOf(const Wanted& wanted) const {
  return HaveSameField(ball, wanted.ball) && loaded_revision == wanted.volume->loaded_revision();
}

std::string BallMaker::ProblemOf(const Wanted& wanted) const {
  const std::lock_guard lock(mutex_);
  return failure_ && failure_->IsOf(wanted) ? failure_->why : std::string();
}

void BallMaker::ForgetProblem() {
  const std::lock_guard lock(mutex_);
  failure_.reset();
}

void BallMaker::Run() {
  pthread_setname_np(pthread_self(), "palpate-ball");
  SetThreadNice(kNice);
  while (true) {
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [this] { return stop_ || is_awake_; });
      if (stop_) return;
      is_awake_ = false;
    }
    const std::optional<Wanted> wanted = wanted_();
    if (wanted && ProblemOf(*wanted).empty()) Make(*wanted);
  }
}

void BallMaker::Make(const Wanted& wanted) {
  LogInfo("a ball of {:g} mm is being made", wanted.ball.radius_mm);
  share_ = 0.0;
  try {
    const bool is_taken =
        take_(MakeFeltBall(wanted.ball, *wanted.volume, *budget_, [&](double share) {
          share_ = share;
          const std::optional<Wanted> now = wanted_();
          const bool is_same = now && HaveSameField(now->ball, wanted.ball) &&
                               now->volume->loaded_revision() == wanted.volume->loaded_revision();
          if (stop_ || !is_same) throw GivenUp();
        }));
    if (!is_taken) throw GivenUp();
  } catch (const GivenUp&) {
    Wake();
  } catch (const std::exception& error) {
    LogWarning("a ball of {:g} mm cannot be felt: {}", wanted.ball.radius_mm, error.what());
    const std::lock_guard lock(mutex_);
    failure_ = {wanted.ball, wanted.volume->loaded_revision(), error.what()};
  }
  share_ = -1.0;
}

}  // namespace palpate
