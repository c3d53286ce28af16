// The ball that a session's volume is felt with: which one is wanted, made and felt.
#include <optional>
#include <utility>

#include "common/error/error.h"
#include "server/log/log.h"
#include "server/session/session.h"

namespace palpate {

// Until another ball is there.
bool Session::MayStay(const FeltBall& ball) const {
  const std::optional<Ball> wanted = BallOf(settings_.haptics, X_DI_);
  // Layers are felt from below only.
  const bool has_side = settings_.haptics.layers.layer.empty() || ball.side() == FreeSide::kBelow;
  return wanted && CanBe(*wanted) && has_side;
}

BallState Session::ball() const {
  const std::lock_guard lock(mutex_);
  BallState state;
  if (ball_) state.felt_radius_mm = ball_->RadiusMm(X_DI_);
  if (has_volume_) state.problem = RefusalOfBall(settings_.haptics, X_DI_);
  const std::optional<BallMaker::Wanted> awaited = MissingBall(settings_.haptics);
  if (!awaited) return state;
  state.problem = ball_maker_.ProblemOf(*awaited);
  state.is_awaited = state.problem.empty();
  state.share_done = ball_maker_.share();
  return state;
}

void Session::CheckRoom(const SettingsUpdate& update) const {
  if (!update.Names(&HapticSettings::tool_radius_mm)) return;
  std::unique_lock lock(mutex_);
  const auto wanted = MissingBall(Changed(*volume_, settings_, update).haptics);
  lock.unlock();
  if (wanted) ClaimFor(wanted->ball, *wanted->volume, *loader_.budget);
}

std::optional<BallMaker::Wanted> Session::MissingBall(const HapticSettings& haptics) const {
  const std::optional<Ball> wanted = BallOf(haptics, X_DI_);
  const bool can_be = wanted && has_volume_ && CanBe(*wanted);
  if (!can_be || (ball_ && HaveSameField(ball_->ball(), *wanted))) return {};
  return BallMaker::Wanted{*wanted, volume_};
}

bool Session::IsWanted(const FeltBall& ball) const {
  const std::optional<Ball> wanted = BallOf(settings_.haptics, X_DI_);
  return wanted && HaveSameField(ball.ball(), *wanted);
}

// The newest edits are caught up with in a transaction: no other comes then.
bool Session::TakeBall(FeltBall made) {
  bool is_taken = false;
  store_.Edit([&](const std::shared_ptr<const VolumeSnapshot>& present) {
    std::optional<FeltBall> newest = Following(made, *present);
    const std::lock_guard lock(mutex_);
    is_taken = newest && IsWanted(*newest);
    if (!is_taken) return VolumeChange();
    SetBallLocked(std::move(newest));
    PublishLocked();
    return VolumeChange();
  });
  return is_taken;
}

void Session::SetBallLocked(std::optional<FeltBall> ball) {
  if (!ball && !ball_) return;
  if (ball_) retired().Add(ball_->field());
  ball_ = std::move(ball);
  ++geometry_revision_;  // another lattice
  if (ball_) LogInfo("a ball of {:g} mm is felt", ball_->RadiusMm(X_DI_));
  loader_.budget->SetPart(kBallInMessages, ball_ ? ball_->field()->bricks().MemoryBytes() : 0);
}

// None if there is no room for its field, unless the load itself asks for the ball: the volume is
// worth more.
std::optional<FeltBall> Session::BallFor(const HapticSettings& felt, const SettingsUpdate& settings,
                                         const AffineMap& X_DI, const VolumeSnapshot& volume,
                                         const LoadProgress& progress) const {
  const std::optional<Ball> ball = BallOf(felt, X_DI);
  if (!ball || !CanBe(*ball)) return {};
  try {
    return MakeFeltBall(*ball, volume, *loader_.budget, [&](double share) {
      progress("making the field of the ball at the tip", share);
    });
  } catch (const Error& error) {
    const bool is_asked_for = settings.Names(&HapticSettings::tool_radius_mm);
    if (error.kind() != ErrorKind::kTooLarge || is_asked_for) throw;
    return {};
  }
}

// None: it takes too long in a transaction, or there is no room. The ball is made anew then, in the
// background; no edit fails because of it.
std::optional<FeltBall> Session::Following(FeltBall ball, const VolumeSnapshot& volume) const {
  const std::optional<std::uint64_t> bytes = ball.BytesToFollow(volume);
  if (!bytes) return {};
  try {
    const MemoryClaim claim = loader_.budget->Claim(kBallInMessages, *bytes);
    ball.Follow(volume);
    return ball;
  } catch (const Error& error) {
    LogWarning("a point is felt: {}", error.what());
    return {};
  }
}

}  // namespace palpate
