#include "server/streaming/volume_feed.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "common/bricks/float_codec.h"
#include "common/error/error.h"
#include "server/streaming/overview.h"

namespace palpate {
namespace {

constexpr std::uint64_t kDefaultWindow = 4;
constexpr std::uint64_t kLargestWindow = 64;
// Bricks checked in one step: 8 MiB at most.
constexpr std::uint64_t kBricksPerSelection = 4096;
// Blocks in one message: 256 KiB, the means of 16 MiB of voxels.
constexpr std::uint64_t kBlocksPerMessage = 65536;
// Of 2^31 voxels. A sparse volume may have a far larger lattice, which no dense copy holds.
constexpr std::uint64_t kMostOverviewBlocks = std::uint64_t{1} << 22;

// Compares bit by bit: a brick that is left out must have the hash of the subscriber's background.
bool IsBackground(const Leaf& leaf, const Brick& background) {
  if (leaf.is_constant()) {
    const float value = leaf[0];
    return std::memcmp(&value, background.data(), sizeof value) == 0;
  }
  const Brick values = leaf.Floats();
  return std::memcmp(values.data(), background.data(), sizeof(Brick)) == 0;
}

std::uint64_t BricksOf(const VolumeSnapshot& volume) {
  return volume.bricks().brick_count().cast<std::uint64_t>().prod();
}

std::uint64_t CheckedWindow(std::uint64_t window) {
  if (window > kLargestWindow) {
    throw Error(ErrorKind::kInvalidArgument, "max_unacknowledged must be from 1 to 64");
  }
  return window == 0 ? kDefaultWindow : window;
}

}  // namespace

VolumeFeed::VolumeFeed(const VolumeFeedOptions& options, std::uint64_t daemon_id,
                       const VolumeNow& now, Clock::time_point time)
    : daemon_id_(daemon_id), window_(CheckedWindow(options.max_unacknowledged)), progress_(time) {
  if (!options.resume_from || options.resume_from->daemon_id != daemon_id) return;
  const std::uint64_t revision = options.resume_from->volume_revision;
  if (revision > now.volume->revision()) {
    throw Error(ErrorKind::kInvalidArgument, "cannot resume from volume revision " +
                                                 std::to_string(revision) + ": the newest is " +
                                                 std::to_string(now.volume->revision()));
  }
  // The subscriber has another volume, so everything is sent.
  if (revision < now.volume->loaded_revision()) return;
  revision_ = revision;
  loaded_revision_ = now.volume->loaded_revision();
}

void VolumeFeed::Acknowledge(std::uint64_t message_number, Clock::time_point time) {
  const std::uint64_t number = std::min(message_number, sent_);
  if (number <= acknowledged_) return;
  acknowledged_ = number;
  progress_ = time;
}

bool VolumeFeed::IsBehind(const VolumeNow& now) const {
  return transfer_ || complete_ || !told_complete_ || revision_ != now.volume->revision();
}

// The placement maps voxel indices. It means nothing to a subscriber that has another volume.
bool VolumeFeed::IsMisplaced(const VolumeNow& now) const {
  return loaded_revision_ == now.volume->loaded_revision() && (!X_DI_ || *X_DI_ != now.X_DI);
}

bool VolumeFeed::HasWork(const VolumeNow& now) const {
  return IsOpen() && (IsBehind(now) || IsMisplaced(now));
}

std::optional<VolumeMessage> VolumeFeed::Step(const VolumeNow& now, Clock::time_point time) {
  progress_ = time;
  std::optional<VolumeEvent> event = NextEvent(now);
  if (!event) return std::nullopt;
  return VolumeMessage{++sent_, std::move(*event)};
}

void VolumeFeed::LetGo(const VolumeNow& now, Clock::time_point time) {
  if (!transfer_ || transfer_->volume->revision() == now.volume->revision()) return;
  if (transfer_->volume->loaded_revision() != now.volume->loaded_revision()) {
    transfer_.reset();
  } else if (time - progress_ > kStall) {
    KeepPartial();
    transfer_.reset();
  }
}

void VolumeFeed::KeepPartial() {
  const Transfer& transfer = *transfer_;
  if (transfer.phase != Phase::kBricks || transfer.next == 0) return;
  // If an earlier partial end lies above `end`, keep it: bricks below `end` have this revision, the
  // others the earlier one, so the earlier statement still holds.
  const std::uint64_t end = transfer.numbers[transfer.next - 1] + 1;
  if (end >= partial_.end) partial_ = {end, transfer.volume->revision()};
}

bool VolumeFeed::HasGot(const BrickDirectory& bricks, std::uint64_t number) const {
  return number < partial_.end && bricks.RevisionOf(bricks.BrickOf(number)) <= partial_.revision;
}

std::optional<VolumeEvent> VolumeFeed::NextEvent(const VolumeNow& now) {
  // Placements and bricks take turns, so that bricks come even while a client keeps moving the
  // volume.
  if (IsMisplaced(now) && !(placed_last_ && IsBehind(now))) {
    placed_last_ = true;
    X_DI_ = now.X_DI;
    return VolumePlacement{now.X_DI, now.settings_revision};
  }
  placed_last_ = false;
  // Drops the rest of a replaced volume: the subscriber would throw it away.
  if (transfer_ && transfer_->volume->loaded_revision() != now.volume->loaded_revision()) {
    transfer_.reset();
  }
  if (!transfer_ && !complete_) Begin(now);
  if (complete_) return TakeComplete();
  switch (transfer_->phase) {
    case Phase::kLattice:
      return TakeLattice();
    case Phase::kSelect:
      Select();
      return std::nullopt;
    case Phase::kOverview:
      return TakeOverview();
    case Phase::kBricks:
      break;
  }
  return TakeBricks();
}

void VolumeFeed::Begin(const VolumeNow& now) {
  // Not emplace(): clang 14 does not see the default constructor of a nested class with default
  // values.
  transfer_ = Transfer{};
  transfer_->volume = now.volume;
  if (loaded_revision_ != now.volume->loaded_revision()) {
    transfer_->phase = Phase::kLattice;
    return;
  }
  if (!revision_) {
    transfer_->phase = Phase::kSelect;
    return;
  }
  const BrickDirectory& bricks = now.volume->bricks();
  transfer_->numbers = bricks.ChangedSince(*revision_);
  std::erase_if(transfer_->numbers, [&](std::uint64_t n) { return HasGot(bricks, n); });
  transfer_->phase = Phase::kBricks;
  if (transfer_->numbers.empty()) HasSentBricks();
}

VolumeEvent VolumeFeed::TakeLattice() {
  const VolumeSnapshot& volume = *transfer_->volume;
  const VolumeMetadata& metadata = volume.metadata();
  revision_.reset();
  partial_ = {};
  overview_sent_ = 0;
  X_DI_.reset();
  loaded_revision_ = volume.loaded_revision();
  transfer_->phase = Phase::kSelect;
  return VolumeLattice{
      .source = metadata.source,
      .size = metadata.size,
      .spacing_mm = metadata.spacing_mm,
      .X_WI = metadata.WorldFromIndex(),
      .value_min = metadata.value_min,
      .value_max = metadata.value_max,
      .background = metadata.is_level_set ? std::optional(metadata.value_max) : std::nullopt,
      .unit = metadata.unit,
      .loaded_revision = volume.loaded_revision()};
}

void VolumeFeed::Select() {
  const VolumeSnapshot& volume = *transfer_->volume;
  Brick background;
  background.fill(static_cast<float>(volume.metadata().Background()));
  const BrickDirectory& bricks = volume.bricks();
  const std::uint64_t end = BricksOf(volume);
  const std::uint64_t stop = std::min(transfer_->next + kBricksPerSelection, end);
  for (; transfer_->next < stop; ++transfer_->next) {
    const std::uint64_t number = transfer_->next;
    const bool has_it = number < partial_.end
                            ? HasGot(bricks, number)
                            : IsBackground(*bricks.At(bricks.BrickOf(number)), background);
    if (!has_it) transfer_->numbers.push_back(number);
  }
  if (transfer_->next < end) return;
  transfer_->next = 0;
  const std::uint64_t blocks = OverviewSize(volume.size()).cast<std::uint64_t>().prod();
  transfer_->phase = Phase::kOverview;
  if (overview_sent_ == blocks || blocks > kMostOverviewBlocks) LeaveOverview();
}

VolumeEvent VolumeFeed::TakeOverview() {
  const VolumeSnapshot& volume = *transfer_->volume;
  VolumeOverview overview{OverviewSize(volume.size()), overview_sent_, {}};
  const std::uint64_t end = overview.size.cast<std::uint64_t>().prod();
  std::vector<float> means(std::min(kBlocksPerMessage, end - overview_sent_));
  FillOverview(volume, overview_sent_, means);
  overview.zstd_values = CompressFloats(means);
  overview_sent_ += means.size();
  if (overview_sent_ == end) LeaveOverview();
  return overview;
}

void VolumeFeed::LeaveOverview() {
  transfer_->phase = Phase::kBricks;
  if (transfer_->numbers.empty()) HasSentBricks();
}

VolumeEvent VolumeFeed::TakeBricks() {
  const BrickDirectory& bricks = transfer_->volume->bricks();
  const std::vector<std::uint64_t>& numbers = transfer_->numbers;
  const std::size_t count = std::min(kBricksPerMessage, numbers.size() - transfer_->next);
  VolumeBricks event;
  std::vector<float> values(count * kBrickVoxels);
  for (std::size_t n = 0; n < count; ++n) {
    const std::uint64_t number = numbers[transfer_->next + n];
    event.numbers.push_back(number);
    bricks.At(bricks.BrickOf(number))->CopyTo(values.data() + n * kBrickVoxels);
  }
  event.zstd_values = CompressFloats(values);
  transfer_->next += count;
  event.bricks_left = numbers.size() - transfer_->next;
  if (event.bricks_left == 0) HasSentBricks();
  return event;
}

void VolumeFeed::HasSentBricks() {
  const VolumeSnapshot& volume = *transfer_->volume;
  complete_ = VolumeComplete{{daemon_id_, volume.revision()}, volume.bricks().content_hash()};
  transfer_.reset();
}

VolumeEvent VolumeFeed::TakeComplete() {
  const VolumeComplete complete = *complete_;
  complete_.reset();
  revision_ = complete.revision.volume_revision;
  partial_ = {};
  told_complete_ = true;
  return complete;
}

}  // namespace palpate
