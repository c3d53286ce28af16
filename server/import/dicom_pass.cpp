#include "server/import/dicom_pass.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <set>
#include <utility>

namespace palpate {
namespace {

constexpr DicomTag kTags[] = {dicom::kAcquisition,   dicom::kTimePosition, dicom::kTimeIndex,
                              dicom::kEcho,          dicom::kEchoTime,     dicom::kTriggerTime,
                              dicom::kCardiacPhase,  dicom::kTriggerDelay, dicom::kFlipAngle,
                              dicom::kInversionTime, dicom::kBValue,       dicom::kKvp,
                              dicom::kKernel,        dicom::kImageType};
// Slices of one pass may have several times, too.
constexpr DicomTag kTimes[] = {dicom::kAcquisitionTime, dicom::kAcquisitionDateTime,
                               dicom::kContentTime};

constexpr double kMostOfIt = 0.6;

// Numbers come before texts, in their order.
struct ByNumber {
  static std::pair<double, std::string> Rank(const std::string& text) {
    char* end = nullptr;
    const double number = std::strtod(text.c_str(), &end);
    const bool is_number = end != text.c_str() && *end == 0 && std::isfinite(number);
    return {is_number ? number : HUGE_VAL, text};
  }
  bool operator()(const std::vector<std::string>& a, const std::vector<std::string>& b) const {
    return std::ranges::lexicographical_compare(a, b, {}, Rank, Rank);
  }
};

using Groups = std::map<std::vector<std::string>, std::vector<std::size_t>, ByNumber>;

Groups GroupedBy(const std::vector<DicomTag>& tags, const std::vector<DicomSlice>& slices) {
  Groups groups;
  for (std::size_t n = 0; n < slices.size(); ++n) {
    std::vector<std::string> key;
    for (const DicomTag& tag : tags) key.push_back(slices[n].content.Text(tag));
    groups[key].push_back(n);
  }
  return groups;
}

// Along the normal.
std::vector<double> HeightsOf(const std::vector<DicomSlice>& slices) {
  const Vec3 normal_W = slices.front().row_W.cross(slices.front().column_W);
  std::vector<double> heights_mm;
  for (const DicomSlice& slice : slices) heights_mm.push_back(normal_W.dot(slice.position_W_mm));
  return heights_mm;
}

// `least_share`: of the whole range, which each group reaches over.
bool AreOverOneRange(const Groups& groups, const std::vector<double>& heights_mm,
                     double least_share) {
  std::vector<std::pair<double, double>> ranges_mm;
  const auto [lowest_mm, highest_mm] = std::ranges::minmax(heights_mm);
  const double least_mm = least_share * (highest_mm - lowest_mm);
  for (const auto& [key, members] : groups) {
    if (members.size() < 2) return false;  // each slice its own: no passes
    const auto [least, greatest] =
        std::ranges::minmax(members, {}, [&](std::size_t n) { return heights_mm[n]; });
    ranges_mm.emplace_back(heights_mm[least], heights_mm[greatest]);
    if (ranges_mm.back().second - ranges_mm.back().first < least_mm) return false;
  }
  std::ranges::sort(ranges_mm);
  for (std::size_t n = 1; n < ranges_mm.size(); ++n) {
    if (ranges_mm[n].first < ranges_mm[n - 1].second) return true;
  }
  return false;
}

// Slices that were measured in turns, every other one first, lie as far apart as they say.
bool AreInTurns(const std::vector<DicomSlice>& slices, std::vector<double> heights_mm,
                const DicomTag& pitch) {
  constexpr double kSamePitch = 0.1;
  std::ranges::sort(heights_mm);
  const std::string text = slices.front().content.Text(pitch);
  const double stated_mm = std::strtod(text.c_str(), nullptr);
  for (std::size_t n = 1; n < heights_mm.size(); ++n) {
    const double pitch_mm = heights_mm[n] - heights_mm[n - 1];
    if (!(std::abs(pitch_mm - stated_mm) < kSamePitch * stated_mm)) return false;
  }
  return true;
}

// The tags that tell passes apart, without those that repeat what others say.
std::vector<DicomTag> TellingTags(const std::vector<DicomSlice>& slices) {
  const std::vector<double> heights_mm = HeightsOf(slices);
  std::vector<DicomTag> telling;
  if (AreInTurns(slices, heights_mm, dicom::kSlicePitch)) return telling;
  std::size_t count = 1;
  const auto add = [&](const DicomTag& tag, double least_share) {
    if (!AreOverOneRange(GroupedBy({tag}, slices), heights_mm, least_share)) return;
    telling.push_back(tag);
    const std::size_t with_tag = GroupedBy(telling, slices).size();
    if (with_tag == count) telling.pop_back();
    count = with_tag;
  };
  for (const DicomTag& tag : kTags) add(tag, 0.0);
  if (AreInTurns(slices, heights_mm, dicom::kThickness)) return telling;
  for (const DicomTag& tag : kTimes) add(tag, kMostOfIt);
  return telling;
}

}  // namespace

bool IsOfOnePass(const DicomSlice& one, const DicomSlice& other) {
  const auto is_same = [&](const DicomTag& tag) {
    return one.content.Text(tag) == other.content.Text(tag);
  };
  return std::ranges::all_of(kTags, is_same) && std::ranges::all_of(kTimes, is_same);
}

std::vector<DicomPass> PassesOf(std::vector<DicomSlice> slices) {
  const std::vector<DicomTag> telling = TellingTags(slices);
  const Groups groups = GroupedBy(telling, slices);
  std::vector<DicomPass> passes;
  std::set<std::string> acquisitions;
  for (const auto& [key, members] : groups) {
    DicomPass& pass = passes.emplace_back();
    for (std::size_t n = 0; n < telling.size(); ++n) {
      pass.description += (n == 0 ? "" : ", ") + std::string(telling[n].name) + " " +
                          (key[n].empty() ? "not stated" : key[n]);
    }
    pass.number = slices[members.front()].content.Text(dicom::kAcquisition);
    acquisitions.insert(pass.number);
    for (const std::size_t n : members) pass.slices.push_back(std::move(slices[n]));
  }
  const bool have_numbers = acquisitions.size() == passes.size() && !acquisitions.contains("");
  for (std::size_t n = 0; n < passes.size() && !have_numbers; ++n) {
    passes[n].number = std::to_string(n + 1);
  }
  if (passes.size() == 1) passes[0].number.clear();
  return passes;
}

}  // namespace palpate
