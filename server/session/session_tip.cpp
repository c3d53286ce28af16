// What a session's volume is felt with, its tip, a ball or a tool: wanted, made and felt.
#include <algorithm>
#include <optional>
#include <utility>

#include "common/error/error.h"
#include "server/log/log.h"
#include "server/session/session.h"
#include "server/session/setting_checks.h"

namespace palpate {
namespace {

std::uint64_t BytesOf(const std::vector<FeltBall>& fields) {
  std::uint64_t bytes = 0;
  for (const FeltBall& field : fields) bytes += field.field()->bricks().MemoryBytes();
  return bytes;
}

bool IsAmong(const Ball& ball, const std::vector<FeltBall>& fields) {
  return std::ranges::any_of(fields,
                             [&](const FeltBall& one) { return HaveSameField(one.ball(), ball); });
}

}  // namespace

// Until another tip is there.
bool Session::MayStay(const FeltTip& tip) const {
  const HapticSettings& haptics = settings_.haptics;
  const std::vector<Ball> wanted = FieldsOf(haptics, X_DI_);
  if (wanted.empty() || !std::ranges::all_of(wanted, CanBe)) return false;
  HapticSettings with_tip = haptics;
  with_tip.tool = tip.tool;
  if (!RefusalWithTool(with_tip).empty()) return false;
  // Layers are felt from below only.
  return haptics.layers.layer.empty() || tip.fields.empty() ||
         tip.fields.front().side() == FreeSide::kBelow;
}

BallState Session::ball() const {
  const std::lock_guard lock(mutex_);
  BallState state;
  if (tip_.ball()) state.felt_radius_mm = tip_.ball()->RadiusMm(X_DI_);
  if (has_volume_) state.problem = RefusalOfTip(settings_.haptics, X_DI_);
  const std::optional<BallMaker::Wanted> awaited = MissingField();
  if (!awaited) return state;
  state.problem = ball_maker_.ProblemOf(*awaited);
  state.is_awaited = state.problem.empty();
  state.share_done = ball_maker_.share();
  return state;
}

void Session::CheckRoom(const SettingsUpdate& update) const {
  if (!update.NamesTip()) return;
  std::unique_lock lock(mutex_);
  const std::vector<Ball> missing = MissingFields(Changed(*volume_, settings_, update).haptics);
  const std::shared_ptr<const VolumeSnapshot> volume = volume_;
  lock.unlock();
  std::vector<MemoryClaim> claims;
  for (const Ball& ball : missing) claims.push_back(ClaimFor(ball, *volume, *loader_.budget));
}

std::vector<Ball> Session::MissingFields(const HapticSettings& haptics) const {
  std::vector<Ball> fields = FieldsOf(haptics, X_DI_);
  if (!has_volume_ || !std::ranges::all_of(fields, CanBe)) return {};
  std::erase_if(
      fields, [&](const Ball& ball) { return IsAmong(ball, tip_.fields) || IsAmong(ball, made_); });
  return fields;
}

std::optional<BallMaker::Wanted> Session::MissingField() const {
  const std::vector<Ball> missing = MissingFields(settings_.haptics);
  if (missing.empty()) return {};
  return BallMaker::Wanted{missing.front(), volume_};
}

// The newest edits are caught up with in a transaction: no other comes then.
bool Session::TakeField(FeltBall made) {
  bool is_taken = false;
  store_.Edit([&](const std::shared_ptr<const VolumeSnapshot>& present) {
    std::vector<FeltBall> newest{made};
    const bool follows = Follow(newest, *present);
    const std::lock_guard lock(mutex_);
    const std::vector<Ball> wanted = FieldsOf(settings_.haptics, X_DI_);
    is_taken = follows && std::ranges::any_of(wanted, [&](const Ball& ball) {
                 return HaveSameField(newest.front().ball(), ball);
               });
    if (!is_taken) return VolumeChange();
    made_.push_back(std::move(newest.front()));
    TellFieldBytes();
    PublishLocked();
    return VolumeChange();
  });
  return is_taken;
}

// Takes the settings' tip if its fields are there. Gives up a tip that may not stay.
void Session::ChooseTipLocked() {
  std::vector<FeltBall> there = tip_.fields;
  there.insert(there.end(), made_.begin(), made_.end());
  FeltTip next = tip_;
  if (!has_volume_ || !Assemble(settings_.haptics, X_DI_, there, next)) {
    if (tip_.has_tool() || !tip_.fields.empty()) {
      if (!MayStay(tip_)) SetTipLocked({});
    }
    return;
  }
  made_.clear();
  TellFieldBytes();
  const bool is_same =
      next.tool == tip_.tool &&
      std::ranges::equal(next.fields, tip_.fields, {}, &FeltBall::field, &FeltBall::field);
  if (!is_same) SetTipLocked(std::move(next));
}

void Session::SetTipLocked(FeltTip tip) {
  for (const FeltBall& field : tip_.fields) retired().Add(field.field());
  const bool has_other_tool = tip.has_tool() && !(tip.tool == tip_.tool);
  tip_ = std::move(tip);
  ++geometry_revision_;  // another lattice
  if (tip_.ball()) LogInfo("a ball of {:g} mm is felt", tip_.ball()->RadiusMm(X_DI_));
  if (has_other_tool) {
    LogInfo("the tool '{}' of {} balls is felt", tip_.tool.name, tip_.tool.ball.size());
  }
  TellFieldBytes();
}

void Session::TellFieldBytes() {
  loader_.budget->SetPart(kBallInMessages, BytesOf(tip_.fields) + BytesOf(made_));
}

// No fields if there is no room for them, unless the load itself asks for the tip: the volume is
// worth more.
std::vector<FeltBall> Session::FieldsFor(const HapticSettings& felt, const SettingsUpdate& settings,
                                         const AffineMap& X_DI, const VolumeSnapshot& volume,
                                         const LoadProgress& progress) const {
  const std::vector<Ball> wanted = FieldsOf(felt, X_DI);
  std::vector<FeltBall> made;
  if (!std::ranges::all_of(wanted, CanBe)) return made;
  try {
    for (const Ball& ball : wanted) {
      made.push_back(MakeFeltBall(ball, volume, *loader_.budget, [&](double share) {
        progress("making the field of the ball at the tip", share);
      }));
    }
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kTooLarge || settings.NamesTip()) throw;
    made.clear();
  }
  return made;
}

// False: it takes too long in a transaction, or there is no room. The fields are made anew then, in
// the background; no edit fails because of it.
bool Session::Follow(std::vector<FeltBall>& fields, const VolumeSnapshot& volume) const {
  try {
    for (FeltBall& field : fields) {
      const std::optional<std::uint64_t> bytes = field.BytesToFollow(volume);
      if (!bytes) return false;
      const MemoryClaim claim = loader_.budget->Claim(kBallInMessages, *bytes);
      field.Follow(volume);
    }
    return true;
  } catch (const Error& error) {
    LogWarning("the ball or tool at the tip is made anew: {}", error.what());
    return false;
  }
}

}  // namespace palpate
