#include "client/web/volume/grouped_volume.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <type_traits>
#include <utility>

#include "client/web/volume/blob.h"
#include "client/web/volume/manifest.h"

namespace palpate::web {
namespace {

Vec3i CeilDiv(const Vec3i& size, int edge) { return (size + Vec3i::Constant(edge - 1)) / edge; }

std::size_t PlaceIn(const Vec3i& place, const Vec3i& size) {
  return (static_cast<std::size_t>(place.x()) * size.y() + place.y()) * size.z() + place.z();
}

// Calls visit(place) for all places from `begin` to before `end`, z fastest.
template <class Visit>
void ForEach(const Vec3i& begin, const Vec3i& end, Visit visit) {
  for (int i = begin.x(); i < end.x(); ++i) {
    for (int j = begin.y(); j < end.y(); ++j) {
      for (int k = begin.z(); k < end.z(); ++k) visit(Vec3i(i, j, k));
    }
  }
}

}  // namespace

Overview::Overview(const Vec3i& size, float background, int least_factor)
    : lattice_(size), factor_(least_factor) {
  while (CeilDiv(size, factor_).maxCoeff() > kMostBlocks) factor_ *= 2;
  cell_ = std::min(factor_, kGroupEdge);
  size_ = CeilDiv(size, factor_);
  cells_ = CeilDiv(size, cell_);
  sums_.resize(cells_.cast<std::size_t>().prod());
  ForEach(Vec3i::Zero(), CeilDiv(size, kGroupEdge),
          [&](const Vec3i& group) { PutConstantGroup(group, background); });
}

// sum(begin, end): of the voxels of the group from `begin` to before `end`.
template <class Sum>
void Overview::PutCells(const Vec3i& group, Sum sum) {
  const Vec3i first = group * kGroupEdge;
  const Vec3i end = (first + Vec3i::Constant(kGroupEdge)).cwiseMin(lattice_);
  ForEach(first / cell_, CeilDiv(end, cell_), [&](const Vec3i& cell) {
    const Vec3i cell_end = ((cell + Vec3i::Ones()) * cell_).cwiseMin(lattice_);
    sums_[PlaceIn(cell, cells_)] = sum(cell * cell_ - first, cell_end - first);
  });
  if (!bytes_.empty()) changed_.push_back(group);
}

void Overview::PutGroup(const Vec3i& group, LeafType type, std::string_view bytes) {
  VisitType(type, [&](auto voxel) {
    const auto* const voxels = reinterpret_cast<const decltype(voxel)*>(bytes.data());
    PutCells(group, [&](const Vec3i& begin, const Vec3i& end) {
      double sum = 0.0;
      ForEach(begin, end, [&](const Vec3i& v) {
        sum += static_cast<double>(voxels[v.x() * 1024 + v.y() * 32 + v.z()]);
      });
      return sum;
    });
  });
}

void Overview::PutConstantGroup(const Vec3i& group, float value) {
  PutCells(group, [&](const Vec3i& begin, const Vec3i& end) {
    return static_cast<double>(value) * (end - begin).prod();
  });
}

double Overview::Mean(const Vec3i& block) const {
  const Vec3i begin = block * factor_;
  const Vec3i end = (begin + Vec3i::Constant(factor_)).cwiseMin(lattice_);
  double sum = 0.0;
  ForEach(begin / cell_, CeilDiv(end, cell_),
          [&](const Vec3i& cell) { sum += sums_[PlaceIn(cell, cells_)]; });
  return sum / (end - begin).cast<double>().prod();
}

const std::string& Overview::Bytes(LeafType type) {
  if (bytes_.empty() || type != type_) {
    type_ = type;
    bytes_.assign(size_.cast<std::size_t>().prod() * VoxelBytes(type), '\0');
    Compute(Vec3i::Zero(), size_);
  } else {
    for (const Vec3i& group : changed_) {
      const Vec3i first = group * kGroupEdge;
      const Vec3i end = (first + Vec3i::Constant(kGroupEdge)).cwiseMin(lattice_);
      Compute(first / factor_, CeilDiv(end, factor_));
    }
  }
  changed_.clear();
  return bytes_;
}

// Blocks from `begin` to before `end`.
void Overview::Compute(const Vec3i& begin, const Vec3i& end) {
  VisitType(type_, [&](auto voxel) {
    using T = decltype(voxel);
    T* const to = reinterpret_cast<T*>(bytes_.data());
    ForEach(begin, end, [&](const Vec3i& block) {
      const double mean = Mean(block);
      to[PlaceIn(block, size_)] = static_cast<T>(std::is_integral_v<T> ? std::round(mean) : mean);
    });
  });
}

namespace {

constexpr std::string_view kBytesType = "application/octet-stream";
constexpr std::string_view kJsonType = "application/json";
constexpr std::size_t kMostOldOverviews = 2;

}  // namespace

std::optional<ManifestInfo> GroupedVolume::Apply(const client::VolumeUpdate& update, Time now) {
  try {
    return Take(update, now);
  } catch (...) {
    is_new_ = true;
    throw;
  }
}

std::optional<ManifestInfo> GroupedVolume::Take(const client::VolumeUpdate& update, Time now) {
  if (update.all) is_new_ = true;
  if (!is_new_) {
    for (const BrickRun& run : update.changed) Mark(run);
  }
  shelf_.Expire(now);
  if (!update.complete || !update.lattice || !update.bricks) return std::nullopt;
  if (std::exchange(is_new_, false)) {
    Begin(*update.lattice, now);
  } else if (dirty_.empty() && revision_ == update.complete) {
    return std::nullopt;
  }
  ReadTypes(*update.bricks);
  ReadVoxels(*update.bricks, now);
  PutOverview(now);
  std::string text = ManifestOf(update);
  const ContentHash hash = HashOfManifest(text);
  Replace(manifest_name_, hash, kJsonType, std::move(text), now);
  revision_ = update.complete;
  shelf_.Expire(now);
  return ManifestInfo{NameOf(hash), *revision_};
}

void GroupedVolume::Begin(const VolumeLattice& lattice, Time now) {
  for (Place& place : groups_) {
    const ContentHash hash = std::exchange(place.hash, {});
    if (hash != ContentHash{}) shelf_.Release(hash, now);
  }
  lattice_ = lattice;
  const float background = lattice.Background();
  background_ = TypedBrick::Constant(
      Holds(lattice.type, background) ? lattice.type : LeafType::kFloat, background);
  const Vec3i bricks = lattice.BrickCounts();
  group_count_ = {GroupCount(bricks.x()), GroupCount(bricks.y()), GroupCount(bricks.z())};
  groups_.assign(group_count_.cast<std::size_t>().prod(), {});
  overview_ = Overview(lattice.size, background, with_groups_ ? 1 : kLeastFactorAlone);
  types_ = {};
  types_.at(static_cast<std::size_t>(groups_.front().type)) =
      static_cast<std::int64_t>(groups_.size());
  type_ = VolumeType();
  MarkAll();
}

void GroupedVolume::MarkAll() {
  dirty_.resize(groups_.size());
  for (std::size_t n = 0; n < groups_.size(); ++n) {
    dirty_[n] = n;
    groups_[n].is_dirty = true;
  }
}

// By rows of bricks along z: a run may have millions.
void GroupedVolume::Mark(const BrickRun& run) {
  if (!lattice_) return;
  const Vec3i count = lattice_->BrickCounts();
  for (std::uint64_t first = run.first; first < run.end();) {
    const Vec3i brick = BrickWithNumber(first, count);
    const auto row = std::min<std::uint64_t>(run.end() - first,
                                             static_cast<std::uint64_t>(count.z() - brick.z()));
    const int last = (brick.z() + static_cast<int>(row) - 1) / kGroupBricks;
    for (Vec3i group = brick / kGroupBricks; group.z() <= last; ++group.z()) {
      const std::uint64_t number = BrickNumber(group, group_count_);
      if (!std::exchange(groups_[number].is_dirty, true)) dirty_.push_back(number);
    }
    first += row;
  }
}

Vec3i GroupedVolume::PlaceOf(std::size_t number) const {
  return BrickWithNumber(number, group_count_);
}

// The only brick of the group, if the map says so without a look at each: a block of the map is
// 2³ groups. At the end of the lattice only the background goes on beyond it.
TypedBrickPtr GroupedVolume::OnlyBrick(const BrickMap& bricks, const Vec3i& group) const {
  const TypedBrickPtr& only = bricks.Only(group / 2);
  if (!only || !only->is_constant() || IsBackground(*only)) return only;
  const Vec3i end = (group + Vec3i::Ones()) * kGroupEdge;
  return (end.array() <= lattice_->size.array()).all() ? only : nullptr;
}

bool GroupedVolume::IsBackground(const TypedBrick& brick) const {
  const float value = brick[0];
  const float background = (*background_)[0];
  return brick.is_constant() &&
         std::bit_cast<std::uint32_t>(value) == std::bit_cast<std::uint32_t>(background);
}

LeafType GroupedVolume::VolumeType() const {
  LeafType type = background_->type();
  for (const LeafType one : kLeafTypes) {
    if (types_.at(static_cast<std::size_t>(one)) > 0) type = CommonType(type, one);
  }
  return type;
}

// If the volume has another type now, all its groups have other bytes.
void GroupedVolume::ReadTypes(const BrickMap& bricks) {
  for (const std::size_t number : dirty_) {
    const Vec3i at = PlaceOf(number);
    const TypedBrickPtr only = OnlyBrick(bricks, at);
    const LeafType type = only ? only->type() : Group(bricks, at, background_).type();
    --types_.at(static_cast<std::size_t>(groups_[number].type));
    ++types_.at(static_cast<std::size_t>(type));
    groups_[number].type = type;
  }
  const LeafType type = VolumeType();
  if (type != type_) MarkAll();
  type_ = type;
}

void GroupedVolume::ReadVoxels(const BrickMap& bricks, Time now) {
  Uniform last;
  for (const std::size_t number : dirty_) {
    Place& place = groups_[number];
    const ContentHash hash = Read(bricks, PlaceOf(number), last);
    if (place.hash != ContentHash{}) shelf_.Release(place.hash, now);
    place.hash = hash;
    place.is_dirty = false;
  }
  dirty_.clear();
}

// Puts the group into the overview and on the shelf. Returns its hash; zero: background.
ContentHash GroupedVolume::Read(const BrickMap& bricks, const Vec3i& at, Uniform& last) {
  const TypedBrickPtr only = OnlyBrick(bricks, at);
  if (only && only->is_constant()) {
    overview_.PutConstantGroup(at, (*only)[0]);
    if (!with_groups_ || IsBackground(*only)) return {};
    if (only == last.brick) {
      shelf_.Use(last.hash, 0, nullptr);
      return last.hash;
    }
  }
  const Group group(bricks, at, background_);
  const std::string bytes = group.Bytes(type_);
  if (!only || !only->is_constant()) overview_.PutGroup(at, type_, bytes);
  if (!with_groups_ || AreAll(bytes, type_, (*background_)[0])) return {};
  const ContentHash hash = HashOfVoxels(type_, bytes);
  shelf_.Use(hash, bytes.size(), [&] {
    return std::make_shared<Blob>(NameOf(hash), kBytesType,
                                  [group, type = type_] { return group.Bytes(type); });
  });
  if (only && only->is_constant()) last = {only, hash};
  return hash;
}

void GroupedVolume::PutOverview(Time now) {
  const std::string& bytes = overview_.Bytes(type_);
  const ContentHash hash = HashOfVoxels(type_, bytes);
  if (overview_name_ == hash) return;
  if (overview_name_) old_overviews_.push_back(*overview_name_);
  Replace(overview_name_, hash, kBytesType, bytes, now);
  std::erase(old_overviews_, hash);
  while (old_overviews_.size() > kMostOldOverviews) {
    shelf_.Drop(old_overviews_.front());
    old_overviews_.pop_front();
  }
}

void GroupedVolume::Replace(std::optional<ContentHash>& held, const ContentHash& hash,
                            std::string_view content_type, std::string bytes, Time now) {
  const std::size_t size = bytes.size();
  shelf_.Use(hash, size, [&] {
    return std::make_shared<Blob>(
        NameOf(hash), content_type,
        [shared = std::make_shared<const std::string>(std::move(bytes))] { return *shared; });
  });
  if (held) shelf_.Release(*held, now);
  held = hash;
  // Every guest fetches it at once: not on the network thread.
  shelf_.Find(NameOf(hash))->Encoded(Encoding::kZstd);
}

std::string GroupedVolume::ManifestOf(const client::VolumeUpdate& update) const {
  Manifest manifest{.size = lattice_->size,
                    .type = type_,
                    .background = (*background_)[0],
                    .value_min = lattice_->value_min,
                    .value_max = lattice_->value_max,
                    .revision = *update.complete,
                    .content_hash = update.content_hash,
                    .overview = *overview_name_,
                    .overview_size = overview_.size(),
                    .overview_factor = overview_.factor(),
                    .groups = {}};
  if (with_groups_) {
    manifest.groups.reserve(groups_.size());
    for (const Place& place : groups_) manifest.groups.push_back(place.hash);
  }
  return ToJson(manifest);
}

}  // namespace palpate::web
