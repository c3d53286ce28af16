#include "server/import/value_checks.h"

#include <algorithm>
#include <cmath>

#include "server/import/image_header.h"

namespace palpate {
namespace {

// Of values with air at 0: shares of the voxels that are air, and soft tissue.
constexpr double kLeastAir = 0.02, kLeastTissue = 0.05;
// Noise of air may lie below 0. Fat and air in Hounsfield units lie lower.
constexpr float kLeastNoise = -200.0f;

bool IsAir(float value) { return value > -100.0f && value < 150.0f; }
bool IsTissue(float value) { return value > 900.0f && value < 1150.0f; }

}  // namespace

void HounsfieldCheck::Add(const float* values, std::size_t count) {
  for (const float* value = values; value != values + count; ++value) {
    if (!std::isfinite(*value)) continue;
    least_ = std::min(least_, *value);
    ++count_;
    air_ += IsAir(*value);
    tissue_ += IsTissue(*value);
  }
}

void HounsfieldCheck::Judge(bool is_ct, std::string* unit, Reporter* reporter) const {
  const auto share = [this](std::int64_t part) {
    return static_cast<double>(part) / static_cast<double>(std::max<std::int64_t>(count_, 1));
  };
  const bool has_air_at_0 = least_ > kLeastNoise && share(air_) >= kLeastAir;
  const bool is_shifted = has_air_at_0 && share(tissue_) >= kLeastTissue;
  const std::string how = is_shifted ? "; they look like HU + 1024: palpate-import --rescale -1024"
                                     : "; palpate-import --rescale states how they lead to HU";
  if (*unit == "HU" && (is_shifted || (is_ct && has_air_at_0 && least_ >= 0.0f))) {
    unit->clear();
    reporter->Warn(
        "the values are no Hounsfield units, as the file says, because none is below 0, where air "
        "and fat are: they have no unit" +
        how);
  } else if (is_ct && unit->empty()) {
    reporter->Warn(
        "this CT does not say how its values lead to Hounsfield units: they have no unit, and no "
        "value stands for bone or skin" +
        how);
  }
}

void DistanceCheck::AddOutside(float value) {
  ++outside_;
  positive_ += value > 0.0f;
}

DistanceCheck::Verdict DistanceCheck::Judge(const Vec3& spacing_mm) const {
  constexpr std::size_t kLeastGradients = 50;
  constexpr double kNearlyAll = 0.9, kTolerance = 0.2;
  const auto are_near_1 = [&](const Vec3& unit) {
    const auto near_1 = std::ranges::count_if(gradients_, [&](const Vec3& gradient) {
      return std::abs(gradient.cwiseQuotient(unit).norm() - 1.0) < kTolerance;
    });
    return static_cast<double>(near_1) > kNearlyAll * static_cast<double>(gradients_.size());
  };
  if (gradients_.size() < kLeastGradients) return Verdict::kNoDistances;
  if (!are_near_1(spacing_mm) && !are_near_1(Vec3::Ones())) return Verdict::kNoDistances;
  const double positive =
      static_cast<double>(positive_) / static_cast<double>(std::max<std::int64_t>(outside_, 1));
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
