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
// Bricks looked at in one step: 8 MiB at most.
constexpr std::uint64_t kBricksPerSelection = 4096;
// Blocks in a message: 256 KiB, means of 16 MiB.
constexpr std::uint64_t kBlocksPerMessage = 65536;

bool IsSame(const AffineMap& a, const AffineMap& b) {
  return a.linear == b.linear && a.translation == b.translation;
}

// Bit by bit: what is left out must hash as what the subscriber puts there.
bool IsBackground(const Brick& brick, const Brick& background) {
  return std::memcmp(brick.data(), background.data(), sizeof(Brick)) == 0;
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
  // Of another volume: all is sent.
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
  return transfer_ || !told_complete_ || revision_ != now.volume->revision();
}

// The map is from voxels: it means nothing to those who have another volume.
bool VolumeFeed::IsMisplaced(const VolumeNow& now) const {
  return loaded_revision_ == now.volume->loaded_revision() && (!X_DI_ || !IsSame(*X_DI_, now.X_DI));
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
  const bool is_void = transfer_->volume->loaded_revision() != now.volume->loaded_revision();
  if (is_void || time - progress_ > kStall) transfer_.reset();
}

std::optional<VolumeEvent> VolumeFeed::NextEvent(const VolumeNow& now) {
  // In turns, so that bricks come while somebody keeps moving the volume.
  if (IsMisplaced(now) && !(placed_last_ && IsBehind(now))) {
    placed_last_ = true;
    X_DI_ = now.X_DI;
    return VolumePlacement{now.X_DI, now.settings_revision};
  }
  placed_last_ = false;
  // What is left of a volume that is gone would be thrown away.
  if (transfer_ && transfer_->volume->loaded_revision() != now.volume->loaded_revision()) {
    transfer_.reset();
  }
  if (!transfer_) Begin(now);
  switch (transfer_->phase) {
    case Phase::kLattice:
      return TakeLattice();
    case Phase::kSelect:
      Select();
      return std::nullopt;
    case Phase::kOverview:
      return TakeOverview();
    case Phase::kBricks:
      return TakeBricks();
    case Phase::kComplete:
      break;
  }
  return TakeComplete();
}

// Without a complete copy of this volume all of it is sent: bricks of a transfer
// that was given up may lie where there is background now.
void VolumeFeed::Begin(const VolumeNow& now) {
  transfer_.emplace();
  transfer_->volume = now.volume;
  if (!revision_ || *revision_ < now.volume->loaded_revision()) {
    transfer_->phase = Phase::kLattice;
    return;
  }
  transfer_->numbers = now.volume->bricks().ChangedSince(*revision_);
  transfer_->phase = transfer_->numbers.empty() ? Phase::kComplete : Phase::kBricks;
}

VolumeEvent VolumeFeed::TakeLattice() {
  const VolumeSnapshot& volume = *transfer_->volume;
  const VolumeMetadata& metadata = volume.metadata();
  revision_.reset();
  X_DI_.reset();
  loaded_revision_ = volume.loaded_revision();
  transfer_->phase = Phase::kSelect;
  return VolumeLattice{.source = metadata.source,
                       .size = metadata.size,
                       .spacing_mm = metadata.spacing_mm,
                       .X_WI = metadata.WorldFromIndex(),
                       .value_min = metadata.value_min,
                       .value_max = metadata.value_max,
                       .unit = metadata.unit,
                       .loaded_revision = volume.loaded_revision()};
}

void VolumeFeed::Select() {
  const VolumeSnapshot& volume = *transfer_->volume;
  Brick background;
  background.fill(static_cast<float>(volume.metadata().value_min));
  const std::uint64_t end = BricksOf(volume);
  const std::uint64_t stop = std::min(transfer_->next + kBricksPerSelection, end);
  for (; transfer_->next < stop; ++transfer_->next) {
    const Vec3i brick = volume.bricks().BrickOf(transfer_->next);
    if (!IsBackground(*volume.bricks().At(brick), background)) {
      transfer_->numbers.push_back(transfer_->next);
    }
  }
  if (transfer_->next < end) return;
  transfer_->next = 0;
  transfer_->phase = Phase::kOverview;
}

VolumeEvent VolumeFeed::TakeOverview() {
  const VolumeSnapshot& volume = *transfer_->volume;
  VolumeOverview overview{OverviewSize(volume.size()), transfer_->next, {}};
  const std::uint64_t end = overview.size.cast<std::uint64_t>().prod();
  const std::uint64_t stop = std::min(transfer_->next + kBlocksPerMessage, end);
  std::vector<float> means(stop - transfer_->next);
  FillOverview(volume, transfer_->next, means);
  overview.zstd_values = CompressFloats(means);
  transfer_->next = stop;
  if (stop == end) {
    transfer_->next = 0;
    transfer_->phase = transfer_->numbers.empty() ? Phase::kComplete : Phase::kBricks;
  }
  return overview;
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
    const Brick& brick = *bricks.At(bricks.BrickOf(number));
    std::copy(brick.begin(), brick.end(), values.data() + n * kBrickVoxels);
  }
  event.zstd_values = CompressFloats(values);
  transfer_->next += count;
  event.bricks_left = numbers.size() - transfer_->next;
  if (event.bricks_left == 0) transfer_->phase = Phase::kComplete;
  return event;
}

VolumeEvent VolumeFeed::TakeComplete() {
  const VolumeSnapshot& volume = *transfer_->volume;
  const VolumeComplete complete{{daemon_id_, volume.revision()}, volume.bricks().content_hash()};
  revision_ = volume.revision();
  told_complete_ = true;
  transfer_.reset();
  return complete;
}

}  // namespace palpate
