#include "server/session/edits/volume_filterer.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>

#include "common/error/error.h"
#include "server/volume/snapshot/brick_memory.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;

// The longest that edits wait if the filter keeps up with them.
constexpr double kBriefSeconds = 0.2;
// The longest that edits wait otherwise. It is less than the 5 s that clients wait for an answer.
constexpr double kLongSeconds = 4.0;
// The longest that edits ever wait. By then, a client may have stopped waiting; its edit or undo is
// not made then.
constexpr double kLongestSeconds = 20.0;
constexpr int kMostRounds = 8;
// The most attempts to filter a whole volume. Each attempt starts again because of an edit.
constexpr int kMostReshapes = 3;
// If a round leaves more than this share of its time to the next one, rounds do not help.
constexpr double kUsefulShare = 0.7;

// The first round's share of the progress. The later rounds share the rest, because their number is
// unknown.
constexpr double kFirstShare = 0.9;

}  // namespace

EditOutcome VolumeFilterer::Filter(const VolumeFilter& filter,
                                   const VolumeEditor::Revision& expected,
                                   const LoadProgress& progress, const LoadCancelled& cancelled) {
  const std::unique_lock filtering(filtering_, std::try_to_lock);
  if (!filtering) {
    throw Error(ErrorKind::kConflict, "another filter is running: try again when it is done");
  }
  if (IsReshape(filter.kind)) return Reshape(filter, expected, progress, cancelled);
  MemoryClaim claim;
  const BrickWork work;
  std::optional<FilterRun> run;
  const auto begin = [&](const VolumeSnapshot&) -> EditResult {
    run.emplace(session_.volume().volume, filter);
    claim = editor_.ClaimFor("the filter", run->MostBytes() + run->WorkBytes());
    return {};
  };
  editor_.Apply(begin, expected);
  progress("filtering", 0.0);
  // The claim shrinks as bricks are made, so that nothing is counted twice for long.
  const auto tell = [&](std::string_view stage, double fraction) {
    claim.Resize(run->MostBytes() + run->WorkBytes() -
                 std::min(run->MostBytes(), work.most_bytes()));
    progress(stage, fraction);
  };
  return Finish(*run, tell, cancelled);
}

EditOutcome VolumeFilterer::Reshape(const VolumeFilter& filter,
                                    const VolumeEditor::Revision& expected,
                                    const LoadProgress& progress, const LoadCancelled& cancelled) {
  const std::unique_lock loading = session_.BeginLoad();
  MemoryClaim claim;
  const auto needs = [&](std::uint64_t bytes) {
    if (claim.bytes() > 0) return claim.Resize(bytes);
    const auto begin = [&](const VolumeSnapshot&) -> EditResult {
      claim = editor_.ClaimFor("the filter", bytes);
      return {};
    };
    editor_.Apply(begin);
  };
  std::shared_ptr<const VolumeSnapshot> volume;
  const auto take = [&](const VolumeSnapshot&) -> EditResult {
    volume = session_.volume().volume;
    if (filter.kind == FilterKind::kResample) editor_.CheckLatticeMayChange();
    return {};
  };
  editor_.Apply(take, expected);
  for (int tries = 0; tries < kMostReshapes; ++tries) {
    const char* const stage = tries == 0 ? "filtering" : "filtering again, after an edit";
    const auto tell = [&](double fraction) { progress(stage, fraction); };
    tell(0.0);
    const ReshapedVolume filtered = palpate::Reshape(*volume, filter, needs, tell, cancelled);
    if (const auto outcome = editor_.Replace(*volume, filtered)) return *outcome;
    volume = session_.volume().volume;
  }
  throw Error(
      ErrorKind::kConflict,
      "the volume was edited while the whole of it was filtered: nothing was filtered; filter "
      "it while nobody edits");
}

EditOutcome VolumeFilterer::Finish(FilterRun& run, const LoadProgress& progress,
                                   const LoadCancelled& cancelled) {
  const char* stage = "filtering";
  double done = 0.0, share = kFirstShare;
  for (int round = 0;; ++round) {
    const Clock::time_point start = Clock::now();
    run.Compute([&](double fraction) { progress(stage, done + share * fraction); }, cancelled);
    const double took = std::chrono::duration<double>(Clock::now() - start).count();
    bool finished = false;
    const EditOutcome outcome = editor_.Apply([&](const VolumeSnapshot&) -> EditResult {
      auto volume = session_.volume().volume;
      if (volume->loaded_revision() != run.volume().loaded_revision()) {
        throw Error(ErrorKind::kConflict,
                    "another volume was loaded while the filter ran: nothing was filtered");
      }
      run.MoveTo(std::move(volume));
      const double left = run.SecondsLeft();
      const bool rounds_help = left < kUsefulShare * took || left > kLongSeconds;
      if (left > kBriefSeconds && rounds_help && round < kMostRounds) return {};
      if (left > kLongestSeconds) {
        throw Error(ErrorKind::kConflict,
                    "the volume is edited faster than it can be filtered: filter a region, or "
                    "while nobody edits");
      }
      // Reports no progress: writing it may wait for a client.
      run.Compute([](double) {}, cancelled);
      finished = true;
      return run.Result();
    });
    if (finished) return outcome;
    stage = "filtering edits";
    done += share;
    share = (1.0 - done) / 2.0;
  }
}

}  // namespace palpate
