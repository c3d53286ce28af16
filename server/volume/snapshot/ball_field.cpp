#include "server/volume/snapshot/ball_field.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <exception>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <unordered_map>
#include <utility>

#include "common/geometry/sphere_directions.h"

namespace palpate {
namespace {

// A ball of more voxels than this needs no points between its lines.
constexpr double kEnoughVoxels = 3.0;
constexpr int kPoints = 128;
// Above it, differences of values could be infinite. Then all are made smaller, without rounding.
constexpr float kGreat = 1e38f, kSmaller = 0.25f;
// An end this near to a vertex is the vertex, in voxels.
constexpr double kAtVertex = 1e-9;
const Vec3i kTile(16, 16, 64), kBrick = Vec3i::Constant(8), kBlock = Vec3i::Constant(64);

int RoundedUp(int number, int to) { return (number + to - 1) / to * to; }

// All functions below are compiled for two kinds of processors, from one source. They round alike.
#define PALPATE_INLINE [[gnu::always_inline]] inline

PALPATE_INLINE void Raise(const float* from, int count, float* to) {
  for (int n = 0; n < count; ++n) to[n] = std::max(to[n], from[n]);
}
PALPATE_INLINE void Blend(const float* one, const float* other, float share, int count, float* to) {
  for (int n = 0; n < count; ++n) to[n] = one[n] + share * (other[n] - one[n]);
}
PALPATE_INLINE void RaiseBlended(const float* one, const float* other, float share, int count,
                                 float* to) {
  for (int n = 0; n < count; ++n) {
    to[n] = std::max(to[n], one[n] + share * (other[n] - one[n]));
  }
}

// One leaf for all bricks of one value.
class ConstantLeaves {
 public:
  LeafPtr Of(float value) {
    const std::lock_guard lock(mutex_);
    LeafPtr& leaf = leaves_[std::bit_cast<std::uint32_t>(value)];
    if (!leaf) leaf = Leaf::Constant(LeafType::kFloat, value);
    return leaf;
  }

 private:
  std::mutex mutex_;
  std::unordered_map<std::uint32_t, LeafPtr> leaves_;
};

}  // namespace

// The vertices min .. min + size - 1 of the field, computed from the volume's around them.
class BallField::Tile {
 public:
  Tile(const BallField& field, const VolumeSnapshot& volume, const Vec3i& min, const Vec3i& size)
      : field_(field), min_(min), size_(size) {
    const Vec3i held = size + 2 * field.reach_;
    stride_ = {held.y() * held.z(), held.z(), 1};
    Read(volume);
    if (is_constant()) return;
    if (std::max(-low_, high_) > kGreat) {
      scale_ = kSmaller;
      for (float& value : in_) value *= scale_;
    }
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2")) {
      FillAvx2();
      return;
    }
#endif
    FillPlain();
  }

  bool is_constant() const { return low_ == high_; }

  // A brick of it.
  LeafPtr LeafAt(const Vec3i& brick, ConstantLeaves& constants) const {
    const float sign = (field_.ball_.is_least ? -1.0f : 1.0f) / scale_;
    if (is_constant()) return constants.Of(sign * low_);
    Brick values;
    const Vec3i first = 8 * brick - min_;
    std::size_t at = 0;
    for (int i = 0; i < 8; ++i) {
      for (int j = 0; j < 8; ++j) {
        const float* row = out_.data() + Place(first + Vec3i(i, j, 0));
        for (int k = 0; k < 8; ++k) values[at++] = sign * row[k];
      }
    }
    const bool is_one_value = std::ranges::all_of(
        values, [&](float value) { return std::memcmp(&value, values.data(), sizeof value) == 0; });
    return is_one_value ? constants.Of(values[0]) : Leaf::Of(LeafType::kFloat, values);
  }

 private:
  // Of a vertex of the tile, in all arrays.
  std::ptrdiff_t Place(const Vec3i& p) const { return (p + field_.reach_).dot(stride_); }

  void Read(const VolumeSnapshot& volume) {
    const Vec3i held = size_ + 2 * field_.reach_;
    const float sign = field_.ball_.is_least ? -1.0f : 1.0f;
    const auto background = sign * static_cast<float>(volume.metadata().Background());
    in_.assign(static_cast<std::size_t>(held.x() * stride_.x()), background);
    low_ = high_ = background;
    const Vec3i begin = min_ - field_.margin_ - field_.reach_;
    const Vec3i from = begin.cwiseMax(0), end = (begin + held).cwiseMin(volume.size());
    if ((from.array() >= end.array()).any()) return;
    const bool is_whole = from == begin && end == begin + held;
    if (is_whole) {
      low_ = std::numeric_limits<float>::infinity();
      high_ = -low_;
    }
    for (int i = from.x(); i < end.x(); ++i) {
      for (int j = from.y(); j < end.y(); ++j) {
        float* row = in_.data() + (Vec3i(i, j, 0) - begin).dot(stride_);
        for (int k = from.z(); k < end.z();) {
          const Leaf& leaf = volume.bricks().Find(i, j, k);
          const int stop = std::min(end.z(), (k | 7) + 1);
          VisitType(leaf.type(), [&](auto type) {
            const auto* voxels = leaf.values<decltype(type)>() + VoxelInBrick(i, j, 0);
            for (; k < stop; ++k) row[k] = sign * static_cast<float>(voxels[k & 7]);
          });
        }
        const auto [low, high] = std::minmax_element(row + from.z(), row + end.z());
        low_ = std::min(low_, *low);
        high_ = std::max(high_, *high);
      }
    }
  }

#ifdef __x86_64__
  [[gnu::target("avx2")]] void FillAvx2() { Fill(); }
#endif
  void FillPlain() { Fill(); }

  PALPATE_INLINE void Fill() {
    out_ = in_;
    raised_.resize(in_.size());
    for (int axis = 0; axis < 3; ++axis) {
      for (const Lines& lines : field_.lines_[axis]) Take(lines, axis);
    }
    for (const Point& point : field_.points_) Take(point);
  }

  // The greatest value along each line goes to raised_, and from there to all columns.
  PALPATE_INLINE void Take(const Lines& lines, int axis) {
    Vec3i wide = Vec3i::Zero();
    wide[(axis + 1) % 3] = lines.widest[0];
    wide[(axis + 2) % 3] = lines.widest[1];
    const Vec3i from = -wide, end = size_ + wide;
    const int count = end.z() - from.z();
    for (int x = from.x(); x < end.x(); ++x) {
      for (int y = from.y(); y < end.y(); ++y) {
        const std::ptrdiff_t at = Place({x, y, from.z()});
        const float* in = in_.data() + at;
        float* out = raised_.data() + at;
        const float* low = in + lines.low.vertex * stride_[axis];
        const float* high = in + lines.high.vertex * stride_[axis];
        const float* beside_low = low + lines.low.is_between() * stride_[axis];
        const float* beside_high = high + lines.high.is_between() * stride_[axis];
        Blend(low, beside_low, lines.low.share, count, out);
        RaiseBlended(high, beside_high, lines.high.share, count, out);
        if (axis != 2) continue;  // a vertex is on lines of all axes
        for (int t = lines.first; t <= lines.last; ++t) Raise(in + t, count, out);
      }
    }
    for (const auto& [a, b] : lines.columns) {
      const std::ptrdiff_t offset = a * stride_[(axis + 1) % 3] + b * stride_[(axis + 2) % 3];
      for (int x = 0; x < size_.x(); ++x) {
        for (int y = 0; y < size_.y(); ++y) {
          const std::ptrdiff_t at = Place({x, y, 0});
          Raise(raised_.data() + at + offset, size_.z(), out_.data() + at);
        }
      }
    }
  }

  PALPATE_INLINE void Take(const Point& point) {
    const auto [u, v, w] = point.share;
    for (int x = 0; x < size_.x(); ++x) {
      for (int y = 0; y < size_.y(); ++y) {
        const std::ptrdiff_t at = Place({x, y, 0});
        const float* a = in_.data() + at + point.vertex.dot(stride_);
        const float *b = a + stride_.y(), *c = a + stride_.x(), *d = c + stride_.y();
        float* out = out_.data() + at;
        for (int n = 0; n < size_.z(); ++n) {
          const float e = a[n] + w * (a[n + 1] - a[n]), f = b[n] + w * (b[n + 1] - b[n]);
          const float g = c[n] + w * (c[n + 1] - c[n]), h = d[n] + w * (d[n + 1] - d[n]);
          const float i = e + v * (f - e), j = g + v * (h - g);
          out[n] = std::max(out[n], i + u * (j - i));
        }
      }
    }
  }

  const BallField& field_;
  const Vec3i min_, size_;
  Vec3i stride_;
  float low_ = 0.0f, high_ = 0.0f;
  float scale_ = 1.0f;  // of in_, out_ and raised_
  std::vector<float> in_, out_, raised_;
};

BallField::BallField(const Ball& ball) : ball_(ball) {
  const Mat3& A = ball.device_from_index;
  const Mat3 metric = A.transpose() * A, inverse = metric.inverse();
  for (int axis = 0; axis < 3; ++axis) {
    const double extent = ball.radius_mm * std::sqrt(inverse(axis, axis));
    reach_[axis] = std::max(1, static_cast<int>(std::ceil(extent - kAtVertex)));
    margin_[axis] = RoundedUp(reach_[axis] + 1, 8);
  }
  for (int axis = 0; axis < 3; ++axis) AddLines(metric, axis);
  if (ball.radius_mm < kEnoughVoxels * A.colwise().norm().maxCoeff()) AddPoints(A.inverse());
}

void BallField::AddLines(const Mat3& metric, int axis) {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const auto at_vertex = [](double t) {
    return std::abs(t - std::round(t)) < kAtVertex ? std::round(t) : t;
  };
  const auto end_at = [](double t) {
    return End{static_cast<int>(std::floor(t)), static_cast<float>(t - std::floor(t))};
  };
  std::map<std::pair<double, double>, Lines> groups;
  for (int a = -reach_[u]; a <= reach_[u]; ++a) {
    for (int b = -reach_[v]; b <= reach_[v]; ++b) {
      const double along = metric(axis, axis), mixed = a * metric(axis, u) + b * metric(axis, v);
      const double across = a * a * metric(u, u) + 2 * a * b * metric(u, v) + b * b * metric(v, v);
      const double root = mixed * mixed - along * (across - ball_.radius_mm * ball_.radius_mm);
      if (root < 0.0) continue;
      const double low = at_vertex((-mixed - std::sqrt(root)) / along);
      const double high = at_vertex((-mixed + std::sqrt(root)) / along);
      Lines& lines = groups[{low, high}];
      lines.low = end_at(low);
      lines.high = end_at(high);
      lines.first = static_cast<int>(std::ceil(low));
      lines.last = static_cast<int>(std::floor(high));
      lines.columns.push_back({a, b});
      lines.widest = {std::max(lines.widest[0], std::abs(a)),
                      std::max(lines.widest[1], std::abs(b))};
    }
  }
  for (auto& [key, lines] : groups) lines_[static_cast<std::size_t>(axis)].push_back(lines);
}

void BallField::AddPoints(const Mat3& index_from_device) {
  VisitDirections(kPoints, [&](const Vec3& direction_D) {
    const Vec3 p_I = index_from_device * (ball_.radius_mm * direction_D);
    Point point;
    for (int axis = 0; axis < 3; ++axis) {
      point.vertex[axis] = std::min(static_cast<int>(std::floor(p_I[axis])), reach_[axis] - 1);
      point.share[static_cast<std::size_t>(axis)] =
          static_cast<float>(p_I[axis] - point.vertex[axis]);
    }
    points_.push_back(point);
  });
}

VolumeMetadata BallField::On(const VolumeMetadata& volume) const {
  VolumeMetadata field = volume;
  field.size += 2 * margin_;
  field.origin_W_mm = volume.WorldFromIndex().Apply(-margin_.cast<double>());
  return field;
}

std::uint64_t BallField::MostBytes(const Vec3i& size) const {
  return BrickDirectory::MemoryBytes(size + 2 * margin_, LeafType::kFloat);
}

// Calls work(n) for each n below `count`, on several threads. Throws what one of them throws.
static void ForEach(int count, int threads, const std::function<void(int)>& work) {
  std::atomic<int> next = 0;
  std::mutex mutex;
  std::exception_ptr thrown;
  const auto run = [&] {
    try {
      for (int n = next++; n < count; n = next++) work(n);
    } catch (...) {
      next = count;
      const std::lock_guard lock(mutex);
      thrown = std::current_exception();
    }
  };
  {
    std::vector<std::jthread> others;
    for (int n = 1; n < std::min(threads, count); ++n) others.emplace_back(run);
    run();
  }
  if (thrown) std::rethrow_exception(thrown);
}

std::shared_ptr<const VolumeSnapshot> BallField::Of(
    const VolumeSnapshot& volume, int threads,
    const std::function<void(double share)>& progress) const {
  const VolumeMetadata metadata = On(volume.metadata());
  // The directory asks for its bricks block by block.
  std::vector<LeafPtr> block(kBrickVoxels);
  ConstantLeaves constants;
  Vec3i block_at = Vec3i::Constant(-1);
  const Vec3i last = metadata.size - Vec3i::Ones();
  std::uint64_t done = 0;
  const Vec3i count = (metadata.size + Vec3i::Constant(7)) / 8;
  const double bricks = static_cast<double>(count.prod());
  const auto fill = [&] {
    const Vec3i min = 64 * block_at;
    const Vec3i size = (last / 8 * 8 + kBrick - min).cwiseMin(kBlock);  // whole bricks
    const Vec3i tiles = (size + kTile - Vec3i::Ones()).cwiseQuotient(kTile);
    ForEach(tiles.x() * tiles.y(), threads, [&](int n) {
      const Vec3i first = Vec3i(n / tiles.y(), n % tiles.y(), 0).cwiseProduct(kTile);
      const Vec3i tile_size = (size - first).cwiseMin(kTile);
      const Tile tile(*this, volume, min + first, tile_size);
      for (int a = 0; a < tile_size.x(); a += 8) {
        for (int b = 0; b < tile_size.y(); b += 8) {
          for (int c = 0; c < tile_size.z(); c += 8) {
            const Vec3i brick = (first + Vec3i(a, b, c)) / 8;
            block[VoxelInBrick(brick.x(), brick.y(), brick.z())] =
                tile.LeafAt(8 * block_at + brick, constants);
          }
        }
      }
    });
  };
  BrickDirectory directory(metadata.size, [&](const Vec3i& brick) {
    if (brick / 8 != block_at) {
      block_at = brick / 8;
      progress(static_cast<double>(done) / bricks);
      fill();
    }
    ++done;
    return block[VoxelInBrick(brick.x() & 7, brick.y() & 7, brick.z() & 7)];
  });
  return std::make_shared<VolumeSnapshot>(metadata, directory.AllChangedAt(volume.revision()),
                                          volume.revision(), volume.loaded_revision());
}

// Tiles over the bricks that may change: a tile's voxels take a third of the time of a brick's by
// themselves.
std::vector<BrickChange> BallField::ChangesOf(const VolumeSnapshot& volume,
                                              const VolumeSnapshot& field,
                                              std::span<const Vec3i> changed, int threads) const {
  const Vec3i count = field.bricks().brick_count(), tile_bricks = kTile / 8;
  const auto less = [](const Vec3i& a, const Vec3i& b) {
    return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end());
  };
  std::map<Vec3i, std::set<Vec3i, decltype(less)>, decltype(less)> tiles(less);
  for (const Vec3i& brick_of_volume : changed) {
    const Vec3i first = 8 * brick_of_volume + margin_ - reach_, end = first + kBrick + 2 * reach_;
    const Vec3i low = first / 8, high = ((end - Vec3i::Ones()) / 8).cwiseMin(count - Vec3i::Ones());
    for (int a = low.x(); a <= high.x(); ++a) {
      for (int b = low.y(); b <= high.y(); ++b) {
        for (int c = low.z(); c <= high.z(); ++c) {
          const Vec3i brick(a, b, c);
          tiles.try_emplace(brick.cwiseQuotient(tile_bricks), less).first->second.insert(brick);
        }
      }
    }
  }
  std::vector<const std::set<Vec3i, decltype(less)>*> work;
  for (const auto& [at, bricks] : tiles) work.push_back(&bricks);
  std::vector<std::vector<BrickChange>> found(work.size());
  ConstantLeaves constants;
  ForEach(static_cast<int>(work.size()), threads, [&](int n) {
    const auto at = static_cast<std::size_t>(n);
    Vec3i low = *work[at]->begin(), high = low;
    for (const Vec3i& brick : *work[at]) {
      low = low.cwiseMin(brick);
      high = high.cwiseMax(brick);
    }
    const Tile tile(*this, volume, 8 * low, 8 * (high - low + Vec3i::Ones()));
    for (const Vec3i& brick : *work[at]) {
      LeafPtr leaf = tile.LeafAt(brick, constants);
      if (!HaveSameBits(*leaf, *field.bricks().At(brick))) found[at].push_back({brick, leaf});
    }
  });
  std::vector<BrickChange> all;
  for (auto& some : found) std::move(some.begin(), some.end(), std::back_inserter(all));
  return all;
}

}  // namespace palpate
