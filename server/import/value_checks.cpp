#include "server/import/value_checks.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/import/image_header.h"

namespace palpate {
namespace {

// Shares of all voxels. Hardly any: noise, or a few odd ones.
constexpr double kHardlyAny = 5e-3, kLeastAir = 0.02, kLeastTissue = 0.05;
// Air that is at 0 lies there in the mean; soft tissue in HU, which lies near, does not.
constexpr double kMostAirMean = 30.0;

}  // namespace

VoxelSink HounsfieldCheck::Watching(VoxelSink sink) {
  return [this, sink = std::move(sink)](LeafType type, const void* voxels, std::size_t count) {
    for (const float value : FloatsOf(type, voxels, count)) Add(value);
    sink(type, voxels, count);
  };
}

void HounsfieldCheck::Add(float value) {
  if (!std::isfinite(value)) return;
  ++count_;
  negative_ += value < 0.0f;
  low_ += value < -50.0f && value > -1500.0f;  // padding lies lower
  plausible_ += value > -1100.0f && value < 4100.0f;
  tissue_ += value > 900.0f && value < 1150.0f;
  between_ += value > 200.0f && value < 800.0f;
  if (std::abs(value) < 150.0f) {
    ++air_;
    air_sum_ += value;
  }
}

void HounsfieldCheck::Judge(bool is_ct, bool has_offset, std::string* unit,
                            Reporter* reporter) const {
  const double count = std::max(count_, 1.0);
  const bool has_air_at_0 = air_ > kLeastAir * count && std::abs(air_sum_) < kMostAirMean * air_;
  const bool is_shifted = has_air_at_0 && low_ < kHardlyAny * count &&
                          tissue_ > kLeastTissue * count && between_ < 0.5 * tissue_;
  const bool has_no_fat = is_ct && !has_offset && has_air_at_0 && negative_ < kHardlyAny * count;
  const bool is_beyond = is_ct && plausible_ < 0.5 * count;
  const std::string how = is_shifted ? "; they look like HU + 1024: palpate-import --rescale -1024"
                                     : "; palpate-import --rescale states how they lead to HU";
  if (*unit == "HU" && (is_shifted || has_no_fat || is_beyond)) {
    unit->clear();
    reporter->Warn(std::string("the file says that its values are Hounsfield units, but ") +
                   (is_shifted  ? "air is at 0"
                    : is_beyond ? "most are beyond -1100 to 4100"
                                : "hardly any is below 0, where air and fat are") +
                   ": they have no unit" + how);
  } else if (is_ct && unit->empty()) {
    reporter->Warn(
        "this CT does not say how its values lead to Hounsfield units: they have no unit, and no "
        "value stands for bone or skin" +
        how);
  }
}

void DistanceCheck::AddOutside(float value) {
  if (!std::isfinite(value) || value == 0.0f) return;  // not known, as beyond a narrow band
  ++outside_;
  positive_ += value > 0.0f;
}

DistanceCheck::Verdict DistanceCheck::Judge(const Vec3& spacing_mm) const {
  constexpr std::size_t kLeastGradients = 20;
  constexpr double kNearlyAll = 0.9, kTolerance = 0.2;
  const auto are_near_1 = [&](const Vec3& unit) {
    const auto near_1 = std::ranges::count_if(gradients_, [&](const Vec3& gradient) {
      return std::abs(gradient.cwiseQuotient(unit).norm() - 1.0) < kTolerance;
    });
    return static_cast<double>(near_1) > kNearlyAll * static_cast<double>(gradients_.size());
  };
  if (gradients_.size() < kLeastGradients) return Verdict::kNoDistances;
  const Vec3 units[] = {spacing_mm, Vec3::Ones(), 1e-3 * spacing_mm, 1e3 * spacing_mm};
  if (std::ranges::none_of(units, are_near_1)) return Verdict::kNoDistances;
  if (outside_ == 0) return Verdict::kBothOutside;
  const double positive = static_cast<double>(positive_) / static_cast<double>(outside_);
  return positive > kNearlyAll         ? Verdict::kPositiveOutside
         : positive < 1.0 - kNearlyAll ? Verdict::kNegativeOutside
                                       : Verdict::kBothOutside;
}

bool IsLevelSet(DistanceCheck::Verdict verdict, Reporter* reporter) {
  const std::string alike = "the values look like signed distances from a surface at 0";
  switch (verdict) {
    case DistanceCheck::Verdict::kNoDistances:
      return false;
    case DistanceCheck::Verdict::kPositiveOutside:
      reporter->Warn(alike + ", positive outside: it is felt as a level set, from there" +
                     kReadOtherwise);
      return true;
    case DistanceCheck::Verdict::kNegativeOutside:
      reporter->Warn(alike + ", negative outside: isovalue 0 shows it");
      return false;
    case DistanceCheck::Verdict::kBothOutside:
      reporter->Warn(alike +
                     ", and it is not clear on which side the outside is; `palpate set free_side` "
                     "chooses it");
      return false;
  }
  return false;
}

}  // namespace palpate
