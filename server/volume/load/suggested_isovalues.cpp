#include "server/volume/load/suggested_isovalues.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "server/volume/load/builtin.h"

namespace palpate {
namespace {

constexpr std::uint64_t kMostVoxels = std::uint64_t{1} << 25;
constexpr std::uint64_t kMostSamples = std::uint64_t{1} << 18;
constexpr int kMostBins = 256;
constexpr double kBackgroundShare = 0.25;
constexpr double kOutliers = 0.001;          // share of values at each end
constexpr double kLeastShareOfRange = 0.02;  // of nearly all values, before outliers are cut off
constexpr double kLeastMaterial = 0.0005;    // share of voxels, for a preset
constexpr double kBone_hu = 300.0;
constexpr double kSkin_hu = -300.0;
constexpr double kLeastCt_hu = -1024.0;  // of a scanner; less is noise of air, or padding
constexpr double kLeastNoise_hu = -1200.0;
constexpr double kLeastPadding = 0.01;  // share of the border
constexpr std::size_t kMostPeaks = 4;
constexpr double kPeakOverValley = 1.5;
constexpr double kLeastPeak = 0.001;  // share of voxels in the peak's bin

// Visits about `most` voxels of the lattice: visit(value, times). The step over bricks is odd, as
// volumes often have a power of two of bricks on a side: an even step would see some layers only.
template <class Visit>
void ForSomeVoxels(const VolumeSnapshot& volume, std::uint64_t most, const Visit& visit) {
  const BrickDirectory& bricks = volume.bricks();
  const auto count = static_cast<std::uint64_t>(bricks.brick_count().cast<std::int64_t>().prod());
  const std::uint64_t step = count * kBrickVoxels > most ? count * kBrickVoxels / most | 1 : 1;
  Brick values;
  for (std::uint64_t n = 0; n < count; n += step) {
    const Vec3i brick = bricks.BrickOf(n);
    const Vec3i size = (volume.size() - brick * kBrickEdge).cwiseMin(kBrickEdge);
    const Leaf& leaf = *bricks.At(brick);
    if (leaf.is_constant()) {
      visit(leaf[0], static_cast<std::uint64_t>(size.prod()));
      continue;
    }
    leaf.CopyTo(values.data());
    for (int i = 0; i < size.x(); ++i) {
      for (int j = 0; j < size.y(); ++j) {
        for (int k = 0; k < size.z(); ++k) visit(values[VoxelInBrick(i, j, k)], 1);
      }
    }
  }
}

// True if values at the volume's border, as outside of a round field of view, are less than a
// scanner's least.
bool HasPadding(const VolumeSnapshot& volume) {
  constexpr int kMostSteps = 64;
  std::uint64_t all = 0, padding = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const Vec3i size = volume.size(), step = (size / kMostSteps).cwiseMax(1);
    Vec3i at;
    for (const int end : {0, size[axis] - 1}) {
      at[axis] = end;
      for (at[u] = 0; at[u] < size[u]; at[u] += step[u]) {
        for (at[v] = 0; at[v] < size[v]; at[v] += step[v]) {
          const Leaf& leaf = volume.bricks().Find(at.x(), at.y(), at.z());
          ++all;
          padding += leaf[VoxelInBrick(at.x(), at.y(), at.z())] < kLeastCt_hu;
        }
      }
    }
  }
  return static_cast<double>(padding) > kLeastPadding * static_cast<double>(all);
}

struct Spread {
  std::optional<float> background;
  double low = 0.0, high = 0.0;  // of nearly all other values
  bool are_whole = true;         // all are whole numbers
};

Spread SpreadOf(const VolumeSnapshot& volume, float least) {
  std::vector<std::pair<float, std::uint64_t>> sample;
  std::uint64_t total = 0;
  ForSomeVoxels(volume, kMostSamples, [&](float value, std::uint64_t times) {
    sample.emplace_back(std::max(value, least), times);
    total += times;
  });
  std::sort(sample.begin(), sample.end());
  // Merges equal values.
  std::size_t last = 0;
  for (std::size_t n = 1; n < sample.size(); ++n) {
    if (sample[n].first == sample[last].first) {
      sample[last].second += sample[n].second;
    } else {
      sample[++last] = sample[n];
    }
  }
  sample.resize(last + 1);
  Spread spread;
  spread.are_whole = std::all_of(sample.begin(), sample.end(),
                                 [](const auto& s) { return s.first == std::floor(s.first); });
  const auto most = std::max_element(sample.begin(), sample.end(),
                                     [](auto& a, auto& b) { return a.second < b.second; });
  // In Hounsfield units the air is a class of its own, and not what a program has cut away.
  const bool is_ct = volume.metadata().unit == "HU";
  if (!is_ct &&
      static_cast<double>(most->second) >= kBackgroundShare * static_cast<double>(total)) {
    spread.background = most->first;
    total -= most->second;
    sample.erase(most);
  }
  const auto quantile = [&](double share) {
    double left = share * static_cast<double>(total);
    for (const auto& [value, times] : sample) {
      left -= static_cast<double>(times);
      if (left < 0.0) return static_cast<double>(value);
    }
    return sample.empty() ? 0.0 : static_cast<double>(sample.back().first);
  };
  spread.low = quantile(kOutliers);
  spread.high = quantile(1.0 - kOutliers);
  return spread;
}

class Bins {
 public:
  Bins(const VolumeMetadata& metadata, const Spread& spread, double least)
      : low_(std::max(metadata.value_min, least)), high_(metadata.value_max) {
    if (spread.high - spread.low < kLeastShareOfRange * (high_ - low_) &&
        spread.high > spread.low) {
      low_ = spread.low;
      high_ = spread.high;
    }
    // One bin for each whole number, where there are few: other bins would leave gaps.
    const bool are_few = spread.are_whole && high_ - low_ < kMostBins;
    counts_.resize(are_few ? static_cast<std::size_t>(high_ - low_) + 1 : kMostBins);
    if (!are_few) return;
    low_ -= 0.5;
    high_ += 0.5;
  }

  void Add(std::size_t bin, std::uint64_t times) { counts_[bin] += times; }
  std::size_t BinOf(double value) const {
    const double bin = (value - low_) / (high_ - low_) * static_cast<double>(counts_.size());
    return static_cast<std::size_t>(std::clamp(bin, 0.0, static_cast<double>(counts_.size() - 1)));
  }
  double Center(double bin) const {
    return low_ + (bin + 0.5) / static_cast<double>(counts_.size()) * (high_ - low_);
  }

  double low() const { return low_; }
  double high() const { return high_; }
  const std::vector<std::uint64_t>& counts() const { return counts_; }

 private:
  double low_, high_;
  std::vector<std::uint64_t> counts_;
};

// Returns the bin, or half bin, after which Otsu's criterion is greatest: the variance between the
// two classes. Between the last value of one class and the first of the other it is the same, so
// the middle is taken. None if there are no two values.
std::optional<double> OtsuBin(const std::vector<std::uint64_t>& counts) {
  double total = 0.0, sum = 0.0;
  for (std::size_t bin = 0; bin < counts.size(); ++bin) {
    total += static_cast<double>(counts[bin]);
    sum += static_cast<double>(bin) * static_cast<double>(counts[bin]);
  }
  double below = 0.0, sum_below = 0.0, greatest = 0.0;
  std::optional<double> best;
  std::size_t last = 0;
  for (std::size_t bin = 0; bin < counts.size(); ++bin) {
    if (counts[bin] == 0) continue;
    if (below > 0.0) {
      const double mean_gap = sum_below / below - (sum - sum_below) / (total - below);
      const double variance = below * (total - below) * mean_gap * mean_gap;
      if (variance > greatest) {
        greatest = variance;
        best = 0.5 * static_cast<double>(last + bin);
      }
    }
    below += static_cast<double>(counts[bin]);
    sum_below += static_cast<double>(bin) * static_cast<double>(counts[bin]);
    last = bin;
  }
  return best;
}

// The highest local maxima of the logarithm of smooth counts.
std::vector<double> PeaksOf(const Bins& bins) {
  std::vector<double> heights(bins.counts().begin(), bins.counts().end());
  for (int round = 0; round < 8; ++round) {
    std::vector<double> smooth = heights;
    for (std::size_t n = 1; n + 1 < heights.size(); ++n) {
      smooth[n] = 0.25 * heights[n - 1] + 0.5 * heights[n] + 0.25 * heights[n + 1];
    }
    heights = std::move(smooth);
  }
  // A peak counts once the heights have fallen below it far enough on both sides.
  std::vector<std::size_t> found;
  std::size_t top = 0;
  double valley = 0.0;
  for (std::size_t n = 0; n < heights.size(); ++n) {
    if (heights[n] > heights[top]) top = n;
    const bool rose = heights[top] > kPeakOverValley * valley && heights[top] > 0.0;
    const bool ends = n + 1 == heights.size();
    if (rose && (heights[n] * kPeakOverValley < heights[top] || ends)) {
      found.push_back(top);
      valley = heights[n];
      top = n;
    } else if (heights[n] < valley) {
      valley = heights[n];
      top = n;
    }
  }
  const double all = std::accumulate(heights.begin(), heights.end(), 0.0);
  std::erase_if(found, [&](std::size_t bin) { return heights[bin] < kLeastPeak * all; });
  std::sort(found.begin(), found.end(), [&](auto a, auto b) { return heights[a] > heights[b]; });
  if (found.size() > kMostPeaks) found.resize(kMostPeaks);
  std::sort(found.begin(), found.end());
  std::vector<double> peaks;
  for (const std::size_t bin : found) peaks.push_back(bins.Center(static_cast<double>(bin)));
  return peaks;
}

// Rounds to what people read: a thousandth of the range or finer.
double Rounded(double value, double range) {
  const double unit = std::pow(10.0, std::floor(std::log10(range / 100.0)) - 1.0);
  const double rounded = std::round(value / unit) * unit;
  return std::isfinite(rounded) ? rounded : value;
}

bool HasMaterial(const std::vector<std::uint64_t>& counts, std::size_t from_bin) {
  const auto from = counts.begin() + static_cast<std::ptrdiff_t>(from_bin);
  const auto all = std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
  const auto material = std::accumulate(from, counts.end(), std::uint64_t{0});
  return static_cast<double>(material) >= kLeastMaterial * static_cast<double>(all) &&
         material < all;
}

// Many files of CT do not state the unit, but have air, or padding like it.
bool LooksLikeCt(const VolumeMetadata& metadata, const Spread& spread, double low,
                 std::vector<double> peaks) {
  if (spread.background) peaks.push_back(*spread.background);
  return metadata.unit.empty() && low > kLeastNoise_hu && metadata.value_max > kBone_hu &&
         std::any_of(peaks.begin(), peaks.end(),
                     [](double peak) { return peak > -1100.0 && peak < -900.0; });
}

// Values less than `least` count as this.
VolumeValues ValuesFrom(const VolumeSnapshot& volume, float least, bool* is_like_ct) {
  const VolumeMetadata& metadata = volume.metadata();
  const Spread spread = SpreadOf(volume, least);
  Bins all(metadata, spread, least), rest = all;
  ForSomeVoxels(volume, kMostVoxels, [&](float value, std::uint64_t times) {
    value = std::max(value, least);
    const std::size_t bin = all.BinOf(value);
    all.Add(bin, times);
    if (value != spread.background) rest.Add(bin, times);
  });
  VolumeValues values{{all.low(), all.high(), all.counts(), PeaksOf(rest)}, {}, false};
  *is_like_ct = LooksLikeCt(metadata, spread, all.low(), values.histogram.peaks);
  const auto suggest = [&](const char* name, double isovalue, const char* reason) {
    isovalue = std::clamp(isovalue, metadata.value_min, metadata.value_max);
    values.suggested.push_back({name, isovalue, reason});
  };
  const double middle = volume.Denormalize(0.5);
  if (metadata.is_level_set) suggest("surface", 0.0, "the surface of a level set");
  if (IsBuiltin(metadata.source)) suggest("surface", middle, "the surface of a built-in shape");
  const auto suggest_tissue = [&](const char* name, double isovalue, const char* reason) {
    const bool is_within = isovalue > all.low() && isovalue < all.high();
    if (is_within && HasMaterial(all.counts(), all.BinOf(isovalue))) {
      suggest(name, isovalue, reason);
    }
  };
  if (metadata.unit == "HU") {
    suggest_tissue("bone", kBone_hu, "bone in CT");
    suggest_tissue("skin", kSkin_hu, "skin in CT");
  }
  if (metadata.is_level_set) return values;
  const std::optional<double> bin = OtsuBin(rest.counts());
  const double otsu = bin ? all.Center(*bin) : middle;
  suggest("otsu", Rounded(otsu, all.high() - all.low()),
          bin ? "Otsu's threshold between two classes of values" : "the middle of the range");
  if (*is_like_ct) {
    suggest_tissue("bone", kBone_hu, "bone, if these are Hounsfield units");
    suggest_tissue("skin", kSkin_hu, "skin, if these are Hounsfield units");
  }
  return values;
}

}  // namespace

VolumeValues ValuesOf(const VolumeSnapshot& volume) {
  const VolumeMetadata& metadata = volume.metadata();
  bool is_like_ct = false;
  if ((metadata.unit == "HU" || metadata.unit.empty()) && metadata.value_min < kLeastCt_hu &&
      kLeastCt_hu < metadata.value_max) {
    const bool has_padding = HasPadding(volume);
    if (has_padding || metadata.value_min > kLeastNoise_hu) {
      VolumeValues values = ValuesFrom(volume, kLeastCt_hu, &is_like_ct);
      values.has_padding = has_padding;
      if (is_like_ct || metadata.unit == "HU") return values;
    }
  }
  return ValuesFrom(volume, std::numeric_limits<float>::lowest(), &is_like_ct);
}

}  // namespace palpate
