#include "server/volume_stream/volume_feed.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <string>
#include <utility>

#include "common/bricks/volume_event.h"
#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"
#include "server/volume/snapshot/brick_packer.h"

namespace palpate {
namespace {

// A block lies within one brick.
static_assert(kBrickEdge % kOverviewEdge == 0);

float MeanOfBlock(const VolumeSnapshot& volume, const Vec3i& block) {
  const Vec3i first = block * kOverviewEdge;
  const Vec3i end = (first.array() + kOverviewEdge).min(volume.size().array()).matrix();
  const Leaf& leaf = volume.bricks().Find(first.x(), first.y(), first.z());
  double sum = 0.0;
  for (int i = first.x(); i < end.x(); ++i) {
    for (int j = first.y(); j < end.y(); ++j) {
      for (int k = first.z(); k < end.z(); ++k) sum += leaf[VoxelInBrick(i, j, k)];
    }
  }
  return static_cast<float>(sum / (end - first).prod());
}

// Computes the means of block `first` and the blocks after it, over the voxels within the lattice.
// Block (i, j, k) of (ni, nj, nk) has the number (i nj + j) nk + k.
void FillOverview(const VolumeSnapshot& volume, std::uint64_t first, std::span<float> means) {
  const Vec3i size = OverviewSize(volume.size());
  for (std::size_t n = 0; n < means.size(); ++n) {
    // Blocks are numbered as bricks are.
    means[n] = MeanOfBlock(volume, BrickWithNumber(first + n, size));
  }
}

}  // namespace

Vec3i OverviewSize(const Vec3i& size_voxels) {
  return {OverviewCount(size_voxels.x()), OverviewCount(size_voxels.y()),
          OverviewCount(size_voxels.z())};
}

namespace {

constexpr std::uint64_t kDefaultWindow = 4;
constexpr std::uint64_t kLargestWindow = 64;
// Bricks checked in one step: 8 MiB at most.
constexpr std::uint64_t kBricksPerSelection = 4096;
// Bricks of background hashed in one step, in a few milliseconds.
constexpr std::uint64_t kBricksPerHash = 32768;
// Blocks in one message: 256 KiB, the means of 16 MiB of voxels.
constexpr std::uint64_t kBlocksPerMessage = 65536;
// Of 2^28 voxels. A larger volume has no overview: it would be as large as many a volume.
constexpr std::uint64_t kMostOverviewBlocks = std::uint64_t{1} << 22;

std::uint32_t BitsOf(float value) { return std::bit_cast<std::uint32_t>(value); }

// Compares bit by bit: a brick that is left out must have the hash of the subscriber's background.
bool IsBackground(const Leaf& leaf, float background) {
  // A shortcut: most bricks differ in their first voxel, or are made as one value.
  if (BitsOf(leaf[0]) != BitsOf(background)) return false;
  if (leaf.is_constant()) return true;
  const Brick values = leaf.Floats();
  return std::all_of(values.begin(), values.end(),
                     [&](float value) { return BitsOf(value) == BitsOf(background); });
}

std::uint64_t BricksOf(const VolumeSnapshot& volume) {
  return volume.bricks().brick_count().cast<std::uint64_t>().prod();
}

float BackgroundOf(const VolumeSnapshot& volume) {
  return static_cast<float>(volume.metadata().Background());
}

std::uint64_t CheckedWindow(std::uint64_t window) {
  if (window > kLargestWindow) {
    throw Error(ErrorKind::kInvalidArgument, "max_unacknowledged must be from 1 to 64");
  }
  return window == 0 ? kDefaultWindow : window;
}

}  // namespace

std::shared_ptr<BackgroundHash> BackgroundHashOf(const VolumeSnapshot& volume) {
  return std::make_shared<BackgroundHash>(BricksOf(volume), BackgroundOf(volume));
}

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
  return loaded_revision_ == now.volume->loaded_revision() &&
         (!X_DI_ || *X_DI_ != now.X_DI || patient_axes_ != now.patient_axes ||
          replayed_ != now.replayed);
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
  if (!old_since_) old_since_ = time;
  if (transfer_->volume->loaded_revision() != now.volume->loaded_revision()) {
    transfer_.reset();
  } else if (time - progress_ > kStall || time - *old_since_ > kLongestOld) {
    KeepPartial();
    transfer_.reset();
  }
}

void VolumeFeed::KeepPartial() {
  const Transfer& transfer = *transfer_;
  if (transfer.sent == 0) return;
  // If an earlier partial end lies above, keep it: bricks below `sent` have this revision, the
  // others the earlier one, so the earlier statement still holds.
  if (transfer.sent >= partial_.end) partial_ = {transfer.sent, transfer.volume->revision()};
}

bool VolumeFeed::HasGot(const BrickDirectory& bricks, std::uint64_t number) const {
  return number < partial_.end && bricks.RevisionOf(bricks.BrickOf(number)) <= partial_.revision;
}

std::optional<VolumeEvent> VolumeFeed::NextEvent(const VolumeNow& now) {
  // Placements and bricks take turns, so that bricks come even while a client keeps moving the
  // volume.
  // Whose the voxels are is told between them: after a revision that is complete, before another.
  const bool is_other = replayed_ != now.replayed;
  const bool is_turn = is_other ? !complete_ : !(placed_last_ && IsBehind(now));
  if (IsMisplaced(now) && is_turn) {
    placed_last_ = true;
    X_DI_ = now.X_DI;
    patient_axes_ = now.patient_axes;
    replayed_ = now.replayed;
    const bool answered = !patient_axes_.empty() && now.volume->metadata().patient_axes.empty();
    return VolumePlacement{now.X_DI, now.settings_revision, patient_axes_, answered, replayed_};
  }
  placed_last_ = false;
  // Drops the rest of a replaced volume: the subscriber would throw it away.
  if (transfer_ && transfer_->volume->loaded_revision() != now.volume->loaded_revision()) {
    transfer_.reset();
  } else if (transfer_ && transfer_->replayed != now.replayed) {
    // Of a replay that has ended, or of what was live before it.
    KeepPartial();
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
  transfer_->replayed = now.replayed;
  old_since_.reset();
  background_hash_ = now.background_hash ? now.background_hash : BackgroundHashOf(*now.volume);
  if (loaded_revision_ != now.volume->loaded_revision()) {
    transfer_->phase = Phase::kLattice;
    return;
  }
  if (!revision_) {
    transfer_->phase = Phase::kSelect;
    return;
  }
  const BrickDirectory& bricks = now.volume->bricks();
  for (const std::uint64_t number : bricks.ChangedSince(*revision_)) {
    if (!HasGot(bricks, number)) AddTo(transfer_->runs, {number, 1});
  }
  BeginBricks();
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
      .window_level = metadata.window_level,
      .window_width = metadata.window_width,
      .loaded_revision = volume.loaded_revision(),
      .type = volume.bricks().made_type()};
}

void VolumeFeed::Select() {
  const VolumeSnapshot& volume = *transfer_->volume;
  const float background = BackgroundOf(volume);
  const BrickDirectory& bricks = volume.bricks();
  const std::uint64_t end = BricksOf(volume);
  std::uint64_t& number = transfer_->selected;
  for (const std::uint64_t stop = std::min(number + kBricksPerSelection, end); number < stop;
       ++number) {
    const bool has_it = number < partial_.end
                            ? HasGot(bricks, number)
                            : IsBackground(*bricks.At(bricks.BrickOf(number)), background);
    if (!has_it) AddTo(transfer_->runs, {number, 1});
  }
  if (number < end) return;
  const std::uint64_t blocks = OverviewSize(volume.size()).cast<std::uint64_t>().prod();
  transfer_->phase = Phase::kOverview;
  if (overview_sent_ == blocks || blocks > kMostOverviewBlocks) BeginBricks();
}

VolumeEvent VolumeFeed::TakeOverview() {
  const VolumeSnapshot& volume = *transfer_->volume;
  VolumeOverview overview{OverviewSize(volume.size()), overview_sent_, {}};
  const std::uint64_t end = overview.size.cast<std::uint64_t>().prod();
  std::vector<float> means(std::min(kBlocksPerMessage, end - overview_sent_));
  FillOverview(volume, overview_sent_, means);
  overview.zstd_values = Compress(std::span<const float>(means));
  overview_sent_ += means.size();
  if (overview_sent_ == end) BeginBricks();
  return overview;
}

void VolumeFeed::BeginBricks() {
  for (const BrickRun& run : transfer_->runs) transfer_->left += run.count;
  transfer_->phase = Phase::kBricks;
  if (transfer_->left == 0) HasSentBricks();
}

VolumeEvent VolumeFeed::TakeBricks() {
  Transfer& transfer = *transfer_;
  const BrickDirectory& bricks = transfer.volume->bricks();
  BrickPacker packer;
  while (transfer.left > 0) {
    BrickRun& run = transfer.runs[transfer.next];
    if (!packer.Add(run.first, *bricks.At(bricks.BrickOf(run.first)))) break;
    transfer.sent = ++run.first;
    --transfer.left;
    if (--run.count == 0) ++transfer.next;
  }
  VolumeBricks event = packer.Take();
  event.bricks_left = transfer.left;
  if (transfer.left == 0) HasSentBricks();
  return event;
}

void VolumeFeed::HasSentBricks() {
  const VolumeSnapshot& volume = *transfer_->volume;
  complete_ = VolumeComplete{{daemon_id_, volume.revision()}, volume.bricks().content_hash(), {}};
  transfer_.reset();
}

std::optional<VolumeEvent> VolumeFeed::TakeComplete() {
  if (!background_hash_->Advance(kBricksPerHash)) return std::nullopt;
  VolumeComplete complete = *complete_;
  complete.background_hash = background_hash_->hash();
  complete_.reset();
  revision_ = complete.revision.volume_revision;
  partial_ = {};
  told_complete_ = true;
  return complete;
}

}  // namespace palpate
