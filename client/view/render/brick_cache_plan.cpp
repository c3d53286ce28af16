// Which bricks the pictures want, and which make room for them.
#include <epoxy/gl.h>

#include <algorithm>
#include <bit>
#include <functional>
#include <limits>
#include <utility>

#include "client/view/render/brick_cache.h"

namespace palpate::view {
namespace {

constexpr std::size_t kBits = 64;
// A nearer brick may change what is seen behind it, and so what is wanted. A bound, so that every
// view comes to an end.
constexpr int kMostExchanges = 8;

template <class Visit>
void ForEachBit(const std::vector<std::uint64_t>& words, const Visit& visit) {
  for (std::size_t n = 0; n < words.size(); ++n) {
    for (std::uint64_t rest = words[n]; rest != 0; rest &= rest - 1) {
      visit(
          static_cast<std::uint32_t>(n * kBits + static_cast<std::size_t>(std::countr_zero(rest))));
    }
  }
}

bool Has(const std::vector<std::uint64_t>& words, std::uint32_t bit) {
  return bit / kBits < words.size() && (words[bit / kBits] >> bit % kBits & 1) != 0;
}

}  // namespace

std::size_t BrickCache::EndPicture(int number, Marks marks, const std::optional<Vec3>& eye_I) {
  glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
  std::vector<std::uint64_t> wanted(slots_.size() / kBits);
  marks_.Read(slots_.size() / 32, wanted.data());
  Picture& picture = pictures_[static_cast<std::size_t>(number)];
  picture.eye_I = eye_I;
  if (marks == Marks::kMore) {
    for (std::size_t n = 0; n < std::min(wanted.size(), picture.wanted.size()); ++n) {
      wanted[n] |= picture.wanted[n];
    }
  }
  // Slices move all the time, and what they want is nearest: far bricks must not make room for them
  // again and again.
  if (marks == Marks::kNewView && number == kSurface) exchanges_ = 0;
  picture.wanted = std::move(wanted);
  ++picture_number_;
  std::size_t missing = 0;
  ForEachBit(picture.wanted, [&](std::uint32_t entry) {
    const std::uint32_t slot = slots_[entry];
    if (slot == kNone) {
      ++missing;
    } else {
      wanted_at_[slot] = picture_number_;
    }
  });
  // Also if nothing is missing: nothing may be missing any more.
  is_plan_due_ = true;
  return missing;
}

void BrickCache::Forget(int picture) { pictures_[static_cast<std::size_t>(picture)] = {}; }

bool BrickCache::IsWanted(std::uint32_t entry) const {
  return std::any_of(pictures_.begin(), pictures_.end(),
                     [&](const Picture& picture) { return Has(picture.wanted, entry); });
}

// From the eye of the surface's picture, in mm. What slices want is nearest.
double BrickCache::DistanceOf(std::uint32_t entry) const {
  double distance = std::numeric_limits<double>::infinity();
  for (const Picture& picture : pictures_) {
    if (!Has(picture.wanted, entry)) continue;
    if (!picture.eye_I) return 0.0;
    const Vec3 middle_I =
        (CellBrickOf(entry) * kBrickEdge).cast<double>() + Vec3::Constant(0.5 * kBrickEdge - 1.0);
    const Vec3 away = middle_I - *picture.eye_I;
    distance = X_DI_ ? (X_DI_->linear * away).norm() : away.norm();
  }
  return distance;
}

void BrickCache::Plan(const ViewVolume& volume) {
  is_plan_due_ = false;
  missing_ = FindMissing(volume);
  const std::size_t wanted = missing_.size();
  MakeRoom(wanted, false);
  if (free_slots_.size() < wanted) EvictOldest(wanted - free_slots_.size(), /*also_wanted=*/false);
  is_full_ = free_slots_.size() < wanted;
  if (!is_full_) return;
  EvictFarther();
  const std::size_t beyond = wanted - std::min(wanted, free_slots_.size());
  missing_.erase(missing_.begin(), missing_.begin() + static_cast<std::ptrdiff_t>(beyond));
}

std::vector<BrickCache::Missing> BrickCache::FindMissing(const ViewVolume& volume) const {
  std::vector<Missing> missing;
  for (std::size_t n = 0; n < pictures_.size(); ++n) {
    ForEachBit(pictures_[n].wanted, [&](std::uint32_t entry) {
      if (slots_[entry] != kNone) return;
      for (std::size_t before = 0; before < n; ++before) {
        if (Has(pictures_[before].wanted, entry)) return;
      }
      const Vec3i brick = CellBrickOf(entry);
      if (volume.RangeOf(brick).IsOneValue() || !volume.HasCome(brick)) return;
      missing.push_back({DistanceOf(entry), entry});
    });
  }
  std::ranges::sort(missing, std::greater(),
                    [](const Missing& one) { return std::pair(one.distance, one.entry); });
  return missing;
}

// Those that no picture has wanted for longest first.
void BrickCache::EvictOldest(std::size_t count, bool also_wanted) {
  std::vector<std::uint32_t> oldest;
  for (std::uint32_t slot = 0; slot < owners_.size(); ++slot) {
    const std::uint64_t owner = owners_[slot];
    if (!IsFine(owner)) continue;
    if (also_wanted || !IsWanted(static_cast<std::uint32_t>(owner))) oldest.push_back(slot);
  }
  std::ranges::sort(oldest, {}, [this](std::uint32_t slot) { return wanted_at_[slot]; });
  oldest.resize(std::min(count, oldest.size()));
  for (const std::uint32_t slot : oldest) Evict(slot);
}

// Far bricks make room for nearer ones that are missing.
void BrickCache::EvictFarther() {
  if (exchanges_ >= kMostExchanges) return;
  std::vector<Missing> held;
  for (const std::uint64_t owner : owners_) {
    if (!IsFine(owner)) continue;
    const auto entry = static_cast<std::uint32_t>(owner);
    held.push_back({DistanceOf(entry), entry});
  }
  std::ranges::sort(held, std::greater(), &Missing::distance);
  // The nearest missing ones have the slots that are free.
  const std::size_t without_slot = missing_.size() - free_slots_.size();
  std::size_t evicted = 0;
  while (evicted < std::min(without_slot, held.size()) &&
         held[evicted].distance > missing_[without_slot - 1 - evicted].distance) {
    Evict(slots_[held[evicted].entry]);
    ++evicted;
  }
  if (evicted == 0) return;
  ++exchanges_;
  ++content_version_;
}

}  // namespace palpate::view
