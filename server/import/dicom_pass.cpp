#include "server/import/dicom_pass.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numeric>
#include <set>
#include <utility>

namespace palpate {
namespace {

// Slices that differ in these never make one volume.
constexpr DicomTag kOfTimesAndKinds[] = {dicom::kTimePosition, dicom::kTimeIndex,
                                         dicom::kEcho,         dicom::kKernel,
                                         dicom::kFilter,       dicom::kComponent};
constexpr DicomTag kStated[] = {dicom::kAcquisition, dicom::kSequence,    dicom::kContrast,
                                dicom::kImageType,   dicom::kDescription, dicom::kAcquisitionDate};
constexpr DicomTag kMeasured[] = {dicom::kEchoTime,    dicom::kInversionTime,  dicom::kFlipAngle,
                                  dicom::kBValue,      dicom::kRepetitionTime, dicom::kKvp,
                                  dicom::kThickness,   dicom::kCardiacPhase,   dicom::kTriggerTime,
                                  dicom::kTriggerDelay};
// Slices of one pass may differ in these, too.
constexpr DicomTag kTimes[] = {dicom::kAcquisitionTime, dicom::kAcquisitionDateTime,
                               dicom::kContentTime};

// The number in a text; NaN: it is none.
double NumberOf(const std::string& text) {
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  return end != text.c_str() && *end == 0 ? number : std::nan("");
}

// Three digits: scanners state what they measured, and not always alike.
std::string RoundedReal(const std::string& text) {
  const double number = NumberOf(text);
  char rounded[32];
  std::snprintf(rounded, sizeof rounded, "%.3g", number);
  return std::isfinite(number) ? rounded : text;
}

// Numbers come before texts, in their order.
struct ByNumber {
  static std::pair<double, std::string> Rank(const std::string& text) {
    const double number = NumberOf(text);
    return {std::isfinite(number) ? number : HUGE_VAL, text};
  }
  bool operator()(const std::string& a, const std::string& b) const { return Rank(a) < Rank(b); }
};

enum class Strength { kWeak, kUsual, kDefinite };

// What may tell passes apart, and the slices of each value.
struct Mark {
  Mark(const char* mark_name, Strength mark_strength, const std::vector<std::string>& of_slice)
      : name(mark_name), strength(mark_strength) {
    for (std::size_t n = 0; n < of_slice.size(); ++n) groups[of_slice[n]].push_back(n);
  }

  const char* name;
  Strength strength;  // weak: slices of one pass may differ in it
  std::map<std::string, std::vector<std::size_t>, ByNumber> groups;
};

// How a series goes up and down its heights.
class Heights {
 public:
  explicit Heights(const std::vector<DicomSlice>& slices) {
    const DicomSlice& first = slices.front();
    const Vec3 normal_W = first.row_W.cross(first.column_W);
    for (const DicomSlice& slice : slices) mm_.push_back(normal_W.dot(slice.position_W_mm));
    constexpr double kMostPitch_mm = 1e3;
    const auto stated = [&](const DicomTag& tag) {
      const double mm = std::abs(NumberOf(first.content.Text(tag)));
      return mm > 0.0 && mm < kMostPitch_mm ? mm : 0.0;
    };
    pitch_mm_ = stated(dicom::kSlicePitch);
    if (pitch_mm_ == 0.0) pitch_mm_ = stated(dicom::kThickness);
  }

  // True if slices of other groups lie at places of the largest one, or between them and closer
  // than slices of one volume lie. Those that fill its gaps are of the same volume.
  bool AreMixed(const Mark& mark) const {
    const auto largest = std::ranges::max_element(
        mark.groups, {}, [](const auto& group) { return group.second.size(); });
    std::set<double> own_mm;
    for (const std::size_t n : largest->second) own_mm.insert(mm_[n]);
    const bool is_weak = mark.strength == Strength::kWeak;
    const auto far = std::ranges::count_if(
        mark.groups, [this](const auto& group) { return Reach(group.second) > 0.75; });
    const bool needs_two = is_weak || (pitch_mm_ == 0.0 && mark.strength != Strength::kDefinite);
    if (own_mm.size() < 2 || (needs_two && far < 2)) return false;
    std::vector<double> steps_mm;
    for (auto at = std::next(own_mm.begin()); at != own_mm.end(); ++at) {
      steps_mm.push_back(*at - *std::prev(at));
    }
    std::ranges::nth_element(steps_mm, steps_mm.begin() + std::ssize(steps_mm) / 2);
    const double step_mm = steps_mm[steps_mm.size() / 2];
    const bool is_whole = !is_weak || (pitch_mm_ > 0.0 && step_mm < 1.1 * pitch_mm_);
    const bool has_pitch = pitch_mm_ > 0.0 && mark.strength != Strength::kDefinite;
    const double close_mm = std::min(0.9 * step_mm, has_pitch ? 0.75 * pitch_mm_ : step_mm);
    int within = 0, mixed = 0, others = 0;
    for (const auto& [key, members] : mark.groups) {
      for (const std::size_t n : members) {
        if (&members == &largest->second) continue;
        ++others;
        const auto above = own_mm.lower_bound(mm_[n]);
        if (above == own_mm.end()) continue;
        if (above == own_mm.begin() && *above > mm_[n]) continue;
        const double below_mm = above == own_mm.begin() ? *above : *std::prev(above);
        const double away_mm = std::min(*above - mm_[n], std::abs(mm_[n] - below_mm));
        ++within;
        mixed += away_mm < 0.1 * step_mm || (is_whole && away_mm < close_mm);
      }
    }
    // Stations may overlap at their ends.
    return 2 * mixed >= within && 4 * mixed >= others && mixed > 0;
  }

  // The turns in which the slices go from end to end, in the order of their InstanceNumbers.
  std::vector<std::string> Turns(const std::vector<DicomSlice>& slices) const {
    std::vector<std::pair<double, std::size_t>> order;
    for (std::size_t n = 0; n < slices.size(); ++n) {
      order.emplace_back(NumberOf(slices[n].content.Text(dicom::kInstanceNumber)), n);
    }
    std::vector<std::string> turns(slices.size(), "1");
    if (std::ranges::any_of(order, [](const auto& item) { return std::isnan(item.first); })) {
      return turns;
    }
    std::ranges::sort(order);
    const auto goes_up = [&](std::size_t n) {  // from the one before
      return mm_[order[n].second] > mm_[order[n - 1].second];
    };
    int turn = 1;
    bool is_upwards = order.size() > 1 && goes_up(1);
    for (std::size_t n = 1; n < order.size(); ++n) {
      if (goes_up(n) != is_upwards) {
        ++turn;
        is_upwards = n + 1 < order.size() && goes_up(n + 1);
      }
      turns[order[n].second] = std::to_string(turn);
    }
    return turns;
  }

  // How often the InstanceNumber of each slice has come up to its height.
  std::vector<std::string> Uses(const std::vector<DicomSlice>& slices) const {
    std::vector<std::size_t> order(slices.size());
    std::iota(order.begin(), order.end(), 0);
    std::ranges::sort(order, {}, [this](std::size_t n) { return mm_[n]; });
    std::map<std::string, int> uses;
    std::vector<std::string> of_slice(slices.size());
    for (const std::size_t n : order) {
      of_slice[n] = std::to_string(++uses[slices[n].content.Text(dicom::kInstanceNumber)]);
    }
    return of_slice;
  }

 private:
  // Over which share of the whole range some slices reach.
  double Reach(const std::vector<std::size_t>& members) const {
    const auto height_mm = [this](std::size_t n) { return mm_[n]; };
    const auto [least, greatest] = std::ranges::minmax(members, {}, height_mm);
    const auto [lowest_mm, highest_mm] = std::ranges::minmax(mm_);
    return (mm_[greatest] - mm_[least]) / std::max(highest_mm - lowest_mm, 1e-9);
  }

  std::vector<double> mm_;  // along the normal, of each slice
  double pitch_mm_ = 0.0;   // as the first slice states it; 0: it does not
};

std::vector<Mark> MarksOf(const std::vector<DicomSlice>& slices, const Heights& heights) {
  std::vector<Mark> marks;
  const auto as_stated = [](const std::string& text) { return text; };
  const auto add = [&](const auto& tags, Strength strength, const auto& text) {
    for (const DicomTag& tag : tags) {
      std::vector<std::string> of_slice;
      for (const DicomSlice& slice : slices) of_slice.push_back(text(slice.content.Text(tag)));
      marks.emplace_back(tag.name, strength, of_slice);
    }
  };
  add(kOfTimesAndKinds, Strength::kDefinite, as_stated);
  add(kStated, Strength::kUsual, as_stated);
  add(kMeasured, Strength::kUsual, RoundedReal);
  add(kTimes, Strength::kWeak, as_stated);
  marks.emplace_back("turn of InstanceNumber", Strength::kWeak, heights.Turns(slices));
  marks.emplace_back("use of InstanceNumber", Strength::kWeak, heights.Uses(slices));
  return marks;
}

// Splits by the first mark that tells, and each part again.
void Split(std::vector<DicomSlice> slices, const std::string& description,
           std::vector<DicomPass>* passes) {
  const Heights heights(slices);
  for (const Mark& mark : MarksOf(slices, heights)) {
    if (mark.groups.size() < 2 || !heights.AreMixed(mark)) continue;
    for (const auto& [value, members] : mark.groups) {
      std::vector<DicomSlice> part;
      for (const std::size_t n : members) part.push_back(std::move(slices[n]));
      Split(std::move(part),
            description + (description.empty() ? "" : ", ") + mark.name + " " +
                (value.empty() ? "not stated" : value),
            passes);
    }
    return;
  }
  passes->push_back({"", description, std::move(slices)});
}

}  // namespace

bool IsOfOnePass(const DicomSlice& one, const DicomSlice& other) {
  const auto is_same = [&](const auto& tags) {
    return std::ranges::all_of(tags, [&](const DicomTag& tag) {
      return one.content.Text(tag) == other.content.Text(tag);
    });
  };
  return is_same(kOfTimesAndKinds) && is_same(kStated) && is_same(kMeasured) && is_same(kTimes);
}

std::vector<DicomPass> PassesOf(std::vector<DicomSlice> slices) {
  std::vector<DicomPass> passes;
  Split(std::move(slices), "", &passes);
  if (passes.size() == 1) return passes;
  std::set<std::string> numbers;
  for (DicomPass& pass : passes) {
    pass.number = pass.slices.front().content.Text(dicom::kAcquisition);
    numbers.insert(pass.number);
  }
  if (numbers.size() == passes.size() && !numbers.contains("")) return passes;
  for (std::size_t n = 0; n < passes.size(); ++n) passes[n].number = std::to_string(n + 1);
  return passes;
}

}  // namespace palpate
