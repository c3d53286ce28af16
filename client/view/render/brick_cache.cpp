#include "client/view/render/brick_cache.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "common/error/error.h"

namespace palpate::view {
namespace {

constexpr int kLargestExponent = 32;
constexpr double kMost = 0x1p50;

double FloatNotAbove(double value) {
  const auto nearest = static_cast<float>(value);
  if (nearest <= value) return nearest;
  return std::nextafter(nearest, -std::numeric_limits<float>::infinity());
}

}  // namespace

ValueScale::ValueScale(double min, double max) {
  const double largest = std::max(std::abs(min), std::abs(max));
  if (!(largest > 0.0) || !std::isfinite(largest)) return;
  factor_ = std::ldexp(1.0, kLargestExponent - std::ilogb(largest));
}

double ValueScale::Scaled(double value) const { return std::clamp(value * factor_, -kMost, kMost); }

Eigen::Vector2d ValueScale::Split(double value) const {
  const double scaled = Scaled(value);
  const double first = FloatNotAbove(scaled);
  return {first, FloatNotAbove(scaled - first)};
}

namespace {

// Slots of an atlas that doubles when it grows.
constexpr std::size_t kSmallAtlas = 4096;

std::uint32_t EntryOf(std::uint32_t table, std::size_t place) {
  return table * kBrickVoxels + static_cast<std::uint32_t>(place);
}

Vec3i PlaceInBlock(std::uint32_t entry) {
  return {static_cast<int>(entry >> 6 & 7), static_cast<int>(entry >> 3 & 7),
          static_cast<int>(entry & 7)};
}

[[noreturn]] void Refuse(const Vec3i& size) {
  throw Error(ErrorKind::kTooLarge,
              "the graphics card has no memory left for the volume of " + std::to_string(size.x()) +
                  " x " + std::to_string(size.y()) + " x " + std::to_string(size.z()) +
                  " voxels: close other programs that use it, or load a resampled or cropped "
                  "volume");
}

template <class Number>
void SortOnce(std::vector<Number>& numbers) {
  std::ranges::sort(numbers);
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
}

}  // namespace

BrickCache::BrickCache(std::size_t budget_bytes)
    : budget_bytes_(budget_bytes),
      card_blocks_(GL_RGBA32UI, sizeof(CardBlock)),
      card_ranges_(GL_RG32F, sizeof(ValueRange)),
      card_slots_(GL_R32UI, sizeof(std::uint32_t)),
      marks_(GL_R32UI, sizeof(std::uint32_t)) {}

void BrickCache::Release() {
  atlas_.Release();
  for (CardBuffer* buffer : {&card_blocks_, &card_ranges_, &card_slots_, &marks_}) {
    buffer->Release();
  }
  blocks_.clear();
  table_block_.clear();
  free_tables_.clear();
  slots_.clear();
  owners_.clear();
  free_slots_.clear();
  wanted_at_.clear();
  coarse_slots_ = 0;
  pending_.clear();
  changed_entries_.clear();
  changed_blocks_.clear();
  missing_.clear();
  is_full_ = false;
  is_plan_due_ = false;
  exchanges_ = 0;
  for (int n = 0; n < kPictures; ++n) Forget(n);
}

std::size_t BrickCache::bytes() const {
  return atlas_.capacity() * BrickAtlas::SlotBytes(atlas_.type()) + card_blocks_.bytes() +
         card_ranges_.bytes() + card_slots_.bytes() + marks_.bytes();
}

bool BrickCache::TakeUp(ViewVolume& volume, std::size_t most_bricks) {
  TakeUpPlacement(volume);
  const VolumeChanges changes = volume.TakeChanges();
  try {
    if (changes.all) {
      Release();
      ++content_version_;
      ++version_;
      if (!volume.lattice()) return true;
      const LeafType type = volume.lattice()->type;
      Begin(volume, Holds(type, volume.lattice()->Background()) ? type : LeafType::kFloat);
    }
    if (!has_volume()) return true;
    TakeBlocks(volume, changes.blocks, most_bricks);
    if (is_plan_due_) Plan(volume);
    for (std::size_t n = 0; n < most_bricks && !missing_.empty(); ++n) {
      const std::uint32_t entry = missing_.back().entry;
      missing_.pop_back();
      slots_[entry] = NewSlot(entry);
      changed_entries_.push_back(entry);
    }
    if (!Flush(volume)) {
      TurnIntoFloats();
      Flush(volume);
    }
  } catch (const Error&) {
    Release();
    throw;
  }
  return missing_.empty();
}

void BrickCache::TakeUpPlacement(const ViewVolume& volume) {
  if (X_DI_ == volume.X_DI()) return;
  X_DI_ = volume.X_DI();
  ++version_;
  ++content_version_;
}

void BrickCache::Begin(const ViewVolume& volume, LeafType type) {
  const VolumeLattice& lattice = *volume.lattice();
  size_ = lattice.size;
  block_count_ = volume.cell_block_count();
  value_min_ = lattice.value_min;
  value_max_ = lattice.value_max;
  scale_ = {value_min_, value_max_};
  background_ = scale_.Scaled(lattice.Background());
  most_slots_ = SIZE_MAX;
  const std::size_t blocks = volume.cell_blocks().size();
  // Shaders read them even where there is no table.
  const bool has_buffers = card_blocks_.Reserve(blocks) && card_ranges_.Reserve(kBrickVoxels) &&
                           card_slots_.Reserve(kBrickVoxels) && marks_.Reserve(kBrickVoxels / 32);
  if (!has_buffers || !atlas_.Allocate(type, BrickAtlas::kRow)) Refuse(size_);
  blocks_.assign(blocks, {background_, background_});
  card_blocks_.Write(0, blocks, blocks_.data());
}

// The atlas's type does not hold a value: all slots become those of floats. Fine bricks stay as far
// as there is memory.
void BrickCache::TurnIntoFloats() {
  std::vector<std::uint32_t> fine;
  for (const std::uint64_t owner : owners_) {
    if (IsFine(owner)) fine.push_back(static_cast<std::uint32_t>(owner));
  }
  for (const std::uint32_t entry : fine) slots_[entry] = kNone;
  changed_entries_.insert(changed_entries_.end(), fine.begin(), fine.end());
  owners_.clear();
  wanted_at_.clear();
  free_slots_.clear();
  pending_.clear();
  most_slots_ = SIZE_MAX;
  if (!atlas_.Allocate(LeafType::kFloat, BrickAtlas::kRow)) Refuse(size_);
  MakeRoom(coarse_slots_, true);
  MakeRoom(coarse_slots_ + fine.size(), false);
  for (std::size_t n = 0; n < blocks_.size(); ++n) {
    if (blocks_[n].table == kNone) continue;
    blocks_[n].coarse = NewSlot(kCoarse | blocks_[n].table);
    changed_blocks_.push_back(n);
  }
  for (const std::uint32_t entry : fine) {
    if (free_slots_.empty()) break;
    slots_[entry] = NewSlot(entry);
  }
  is_plan_due_ = true;
  ++content_version_;
}

// --- Blocks

void BrickCache::TakeBlocks(const ViewVolume& volume, std::span<const VolumeChanges::Block> blocks,
                            std::size_t most_bricks) {
  if (blocks.empty()) return;
  ++version_;
  ++content_version_;
  is_plan_due_ = true;
  exchanges_ = 0;
  std::size_t tables = 0;
  for (const VolumeChanges::Block& block : blocks) {
    const bool varies = volume.cell_blocks()[block.number].bricks != nullptr;
    tables += varies && blocks_[block.number].table == kNone ? 1 : 0;
  }
  MakeRoom(tables, false);
  if (free_slots_.size() < tables) EvictOldest(tables - free_slots_.size(), /*also_wanted=*/true);
  MakeRoom(tables, true);
  const std::size_t new_tables = tables - std::min(tables, free_tables_.size());
  const std::size_t entries = slots_.size() + new_tables * kBrickVoxels;
  const bool has_room =
      card_ranges_.Reserve(entries) && card_slots_.Reserve(entries) && marks_.Reserve(entries / 32);
  if (!has_room) Refuse(size_);
  for (const VolumeChanges::Block& block : blocks) TakeBlock(volume, block, most_bricks);
}

void BrickCache::TakeBlock(const ViewVolume& volume, const VolumeChanges::Block& changed,
                           std::size_t& most_bricks) {
  const CellBlock& from = volume.cell_blocks()[changed.number];
  CardBlock& to = blocks_[changed.number];
  changed_blocks_.push_back(changed.number);
  to.min = scale_.Scaled(from.range.min);
  to.max = scale_.Scaled(from.range.max);
  if (!from.bricks) {
    if (to.table != kNone) DropTable(changed.number);
    return;
  }
  if (to.table == kNone) {
    MakeTable(changed.number);
    WriteRanges(from, to.table, CellBricks().set());
  } else {
    WriteRanges(from, to.table, changed.bricks);
    TakeFineBricks(volume, changed.number, changed.bricks, most_bricks);
  }
  pending_.push_back(to.coarse);
}

void BrickCache::MakeTable(std::uint64_t block) {
  CardBlock& to = blocks_[block];
  if (free_tables_.empty()) {
    to.table = static_cast<std::uint32_t>(table_block_.size());
    table_block_.push_back(block);
    slots_.resize(slots_.size() + kBrickVoxels, kNone);
  } else {
    to.table = free_tables_.back();
    free_tables_.pop_back();
    table_block_[to.table] = block;
  }
  // The buffer may hold anything.
  card_slots_.Write(EntryOf(to.table, 0), kBrickVoxels, &slots_[EntryOf(to.table, 0)]);
  to.coarse = NewSlot(kCoarse | to.table);
  ++coarse_slots_;
}

void BrickCache::DropTable(std::uint64_t block) {
  CardBlock& from = blocks_[block];
  for (std::size_t place = 0; place < kBrickVoxels; ++place) {
    const std::uint32_t slot = slots_[EntryOf(from.table, place)];
    if (slot != kNone) Evict(slot);
  }
  FreeSlot(from.coarse);
  --coarse_slots_;
  for (Picture& picture : pictures_) {
    constexpr std::size_t kWords = kBrickVoxels / 64;
    for (std::size_t n = from.table * kWords; n < (from.table + 1) * kWords; ++n) {
      if (n < picture.wanted.size()) picture.wanted[n] = 0;
    }
  }
  free_tables_.push_back(from.table);
  from.table = from.coarse = kNone;
}

void BrickCache::WriteRanges(const CellBlock& block, std::uint32_t table,
                             const CellBricks& bricks) const {
  std::size_t first = 0;
  std::size_t last = kBrickVoxels - 1;
  while (first < last && !bricks[first]) ++first;
  while (last > first && !bricks[last]) --last;
  std::array<ValueRange, kBrickVoxels> scaled;
  for (std::size_t n = first; n <= last; ++n) {
    scaled[n] = {scale_.Scaled((*block.bricks)[n].min), scale_.Scaled((*block.bricks)[n].max)};
  }
  card_ranges_.Write(EntryOf(table, first), last - first + 1, &scaled[first]);
}

// Uploads changed bricks anew. Those beyond `most_bricks` are shown coarsely until they come again.
void BrickCache::TakeFineBricks(const ViewVolume& volume, std::uint64_t block,
                                const CellBricks& bricks, std::size_t& most_bricks) {
  const Vec3i first = BrickWithNumber(block, block_count_) * kBrickEdge;
  for (std::size_t place = 0; place < kBrickVoxels; ++place) {
    if (!bricks[place]) continue;
    const std::uint32_t entry = EntryOf(blocks_[block].table, place);
    const std::uint32_t slot = slots_[entry];
    if (slot == kNone) continue;
    const bool varies = !(*volume.cell_blocks()[block].bricks)[place].IsOneValue();
    if (most_bricks > 0 && varies && volume.HasCome(first + PlaceInBlock(entry))) {
      --most_bricks;
      pending_.push_back(slot);
    } else {
      Evict(slot);
    }
  }
}

// --- Slots

std::size_t BrickCache::MostSlots() const {
  const std::size_t others =
      card_blocks_.bytes() + card_ranges_.bytes() + card_slots_.bytes() + marks_.bytes();
  const std::size_t left = budget_bytes_ > others ? budget_bytes_ - others : 0;
  return std::min(most_slots_, left / BrickAtlas::SlotBytes(atlas_.type()));
}

void BrickCache::MakeRoom(std::size_t slots, bool beyond_budget) {
  if (free_slots_.size() >= slots) return;
  const std::size_t needed = owners_.size() - free_slots_.size() + slots;
  const std::size_t most = std::max(MostSlots(), owners_.size());
  const std::size_t target = beyond_budget ? needed : std::min(needed, most);
  if (target <= owners_.size()) return;
  // A growing atlas is filled anew, so it should not grow often.
  const std::size_t more = std::max(target / 32, std::min(target, kSmallAtlas));
  const std::size_t generous = std::max(target, std::min(target + more, most));
  if (Allocate(generous) || Allocate(target)) return;
  most_slots_ = owners_.size();
  if (beyond_budget || !Allocate(owners_.size())) Refuse(size_);
}

bool BrickCache::Allocate(std::size_t slots) {
  const bool is_anew = slots > atlas_.capacity();
  if (is_anew && !atlas_.Allocate(atlas_.type(), static_cast<std::uint32_t>(
                                                     std::min<std::size_t>(slots, kNone)))) {
    return false;
  }
  owners_.resize(std::max(slots, owners_.size()), kNobody);
  wanted_at_.resize(owners_.size(), 0);
  free_slots_.clear();
  if (is_anew) pending_.clear();
  for (std::size_t slot = owners_.size(); slot-- > 0;) {
    const bool is_free = owners_[slot] == kNobody;
    if (is_free || is_anew) {
      (is_free ? free_slots_ : pending_).push_back(static_cast<std::uint32_t>(slot));
    }
  }
  return true;
}

std::uint32_t BrickCache::NewSlot(std::uint64_t owner) {
  const std::uint32_t slot = free_slots_.back();
  free_slots_.pop_back();
  owners_[slot] = owner;
  wanted_at_[slot] = picture_number_;
  pending_.push_back(slot);
  return slot;
}

void BrickCache::FreeSlot(std::uint32_t slot) {
  owners_[slot] = kNobody;
  free_slots_.push_back(slot);
}

void BrickCache::Evict(std::uint32_t slot) {
  const auto entry = static_cast<std::uint32_t>(owners_[slot]);
  slots_[entry] = kNone;
  changed_entries_.push_back(entry);
  FreeSlot(slot);
}

// --- To the card

// Returns false if the atlas's type does not hold a value.
bool BrickCache::Flush(const ViewVolume& volume) {
  if (pending_.empty() && changed_entries_.empty() && changed_blocks_.empty()) return true;
  ++version_;
  if (!UploadPending(volume)) return false;
  WriteEntries();
  WriteBlocks();
  return true;
}

bool BrickCache::UploadPending(const ViewVolume& volume) {
  SortOnce(pending_);
  std::erase_if(pending_, [this](std::uint32_t slot) { return owners_[slot] == kNobody; });
  for (std::size_t first = 0; first < pending_.size();) {
    std::size_t end = first + 1;
    while (end < pending_.size() && pending_[end] == pending_[end - 1] + 1 &&
           pending_[end] % BrickAtlas::kRow != 0) {
      ++end;
    }
    const std::span run(&pending_[first], end - first);
    const bool held = VisitType(
        atlas_.type(), [&](auto value) { return UploadRun<decltype(value)>(volume, run); });
    if (!held) return false;
    first = end;
  }
  pending_.clear();
  return true;
}

template <class T>
bool BrickCache::UploadRun(const ViewVolume& volume, std::span<const std::uint32_t> slots) {
  const std::size_t values = slots.size() * kCorners;
  staging_.resize(BrickAtlas::kRow * kCorners * sizeof(T));
  T* const staged = reinterpret_cast<T*>(staging_.data());
  const auto row = static_cast<std::ptrdiff_t>(slots.size()) * kCornerEdge;
  for (std::size_t n = 0; n < slots.size(); ++n) {
    const CornerTarget<T> to{staged + n * kCornerEdge, row, row * kCornerEdge};
    const std::uint64_t owner = owners_[slots[n]];
    if (IsFine(owner)) {
      const auto entry = static_cast<std::uint32_t>(owner);
      if (!to.Copy(volume, CellBrickOf(entry))) return false;
      ++uploaded_;
    } else {
      const std::uint64_t block = table_block_[owner & ~kCoarse];
      if (!to.CopyCoarse(volume, BrickWithNumber(block, block_count_))) return false;
    }
  }
  if constexpr (std::is_same_v<T, float>) {
    for (std::size_t n = 0; n < values; ++n) staged[n] = scale_.Scaled(staged[n]);
  }
  atlas_.Upload(slots.front(), static_cast<std::uint32_t>(slots.size()), staged);
  return true;
}

// One write per table: an entry costs about as much.
void BrickCache::WriteEntries() {
  SortOnce(changed_entries_);
  for (auto first = changed_entries_.begin(); first != changed_entries_.end();) {
    const auto end =
        std::lower_bound(first, changed_entries_.end(), EntryOf(*first / kBrickVoxels + 1, 0));
    card_slots_.Write(*first, *std::prev(end) - *first + 1, &slots_[*first]);
    first = end;
  }
  changed_entries_.clear();
}

void BrickCache::WriteBlocks() {
  SortOnce(changed_blocks_);
  for (auto first = changed_blocks_.begin(); first != changed_blocks_.end();) {
    constexpr std::uint64_t kNear = 64;
    auto last = first;
    while (std::next(last) != changed_blocks_.end() && *std::next(last) - *last < kNear) ++last;
    card_blocks_.Write(*first, *last - *first + 1, &blocks_[*first]);
    first = std::next(last);
  }
  changed_blocks_.clear();
}

Vec3i BrickCache::CellBrickOf(std::uint32_t entry) const {
  const std::uint64_t block = table_block_[entry / kBrickVoxels];
  return BrickWithNumber(block, block_count_) * kBrickEdge + PlaceInBlock(entry);
}

}  // namespace palpate::view
