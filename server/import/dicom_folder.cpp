#include "server/import/dicom_folder.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <tuple>
#include <utility>
#include <vector>

#include "server/import/data_check.h"
#include "server/import/dicom_slice.h"

namespace palpate {
namespace {

// Tells the passes of a series apart: slices over the same range that do not make one volume, such
// as phases, echoes or two acquisitions, one between the slices of the other.
//
// Pure. Threads: any. Errors: none.
struct DicomPass {
  std::string number;       // to choose it by; empty: the only pass
  std::string description;  // "EchoNumbers 2, FlipAngle 5"
  std::vector<DicomSlice> slices;
};

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

// True if nothing tells the two slices apart as of two passes.
bool IsOfOnePass(const DicomSlice& one, const DicomSlice& other) {
  const auto is_same = [&](const auto& tags) {
    return std::ranges::all_of(tags, [&](const DicomTag& tag) {
      return one.content.Text(tag) == other.content.Text(tag);
    });
  };
  return is_same(kOfTimesAndKinds) && is_same(kStated) && is_same(kMeasured) && is_same(kTimes);
}

// `slices`: of one series, size and orientation, not empty. What differs between slices tells
// passes apart only if some lie between others, or at their places: a scanner that steps from place
// to place may number its steps, and one that measures in turns has several times. The number is
// the AcquisitionNumber where each pass has one of its own.
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

namespace fs = std::filesystem;

constexpr std::size_t kMostFiles = 100'000;
constexpr int kDeepestFolder = 8;
constexpr char kAllPasses[] = "all";

struct Found {
  std::vector<DicomSlice> slices;
  FileNotes left_out;
  FileNotes repairs;
};

// Adds the file if it is a slice. Files that are no DICOM images are passed over, unless their name
// says otherwise.
void AddFile(const fs::path& path, const ImportLimits& limits, Found* found) {
  std::error_code error;
  const auto length = static_cast<std::int64_t>(fs::file_size(path, error));
  std::ifstream in(path, std::ios::binary);
  if (error || !in) return found->left_out.Add("it cannot be opened", path);
  try {
    DicomFile file = CheckDicomFile(&in, length);
    const bool is_named_so = Lower(path.extension().string()) == ".dcm";
    if (!file.is_dicom && is_named_so) found->left_out.Add("it is no DICOM file", path);
    if (!file.has_pixels) return;
    found->slices.push_back(ParseSlice(path, std::move(file), limits, &found->repairs));
  } catch (const Error& failure) {
    found->left_out.Add(failure.what(), path);
  }
}

void CheckListable(const fs::path& folder) {
  std::error_code error;
  const fs::directory_iterator entries(folder, error);
  if (error == std::errc::permission_denied) {
    throw Error(ErrorKind::kPermissionDenied,
                "the folder may not be read; give this user the permission");
  }
  if (error) Refuse("the folder cannot be read: " + error.message());
}

// `below`: with those of the folders below, as far as they may be read.
std::vector<fs::path> FilesOf(const fs::path& folder, bool below, const ImportLimits& limits) {
  CheckListable(folder);
  std::vector<fs::path> files;
  std::error_code error;
  fs::recursive_directory_iterator entry(folder, fs::directory_options::skip_permission_denied,
                                         error);
  for (; !error && entry != fs::end(entry); entry.increment(error)) {
    std::error_code unknown;
    if (!below || entry.depth() >= kDeepestFolder) entry.disable_recursion_pending();
    if (!entry->is_regular_file(unknown) || limits.own_files.Hold(entry->path())) continue;
    CheckPlace(entry->path(), limits);
    files.push_back(entry->path());
    if (files.size() > kMostFiles) {
      Refuse("the folder holds more than " + std::to_string(kMostFiles) +
             " files; give the one with the series");
    }
  }
  if (error) Refuse("the folder cannot be read: " + error.message());
  std::ranges::sort(files);
  return files;
}

Found Find(const fs::path& folder, bool below, const ImportLimits& limits) {
  Found found;
  for (const fs::path& path : FilesOf(folder, below, limits)) AddFile(path, limits, &found);
  return found;
}

bool Fit(const DicomSlice& one, const DicomSlice& other) {
  return one.size == other.size && one.order == other.order &&
         (one.row_W - other.row_W).norm() <= kParallelSlices &&
         (one.column_W - other.column_W).norm() <= kParallelSlices &&
         std::abs(one.spacing_mm[0] / other.spacing_mm[0] - 1.0) <= kParallelSlices &&
         std::abs(one.spacing_mm[1] / other.spacing_mm[1] - 1.0) <= kParallelSlices;
}

std::size_t PixelHash(const DicomSlice& slice) {
  std::string bytes(static_cast<std::size_t>(slice.content.pixels_end - slice.content.pixels_begin),
                    '\0');
  std::ifstream in(slice.file, std::ios::binary);
  in.seekg(slice.content.pixels_begin);
  in.read(bytes.data(), std::ssize(bytes));
  return std::hash<std::string>()(bytes);
}

bool AreOneInstance(const DicomSlice& one, const DicomSlice& other) {
  const std::string instance = one.content.Text(dicom::kInstance);
  return !instance.empty() && instance == other.content.Text(dicom::kInstance);
}

// Slices of one series that fit, without copies.
class Stack {
 public:
  explicit Stack(DicomSlice first) { Put(std::move(first), {}); }
  explicit Stack(DicomPass pass)
      : slices_(std::move(pass.slices)),
        number_(std::move(pass.number)),
        description_(std::move(pass.description)) {}

  bool Takes(const DicomSlice& slice) const { return Fit(slices_.front(), slice); }
  void Add(DicomSlice slice, FileNotes* left_out) {
    std::optional<std::size_t> hash;
    const auto same_place = places_.equal_range(Place(slice));
    for (auto at = same_place.first; at != same_place.second; ++at) {
      const DicomSlice& other = slices_[at->second];
      std::optional<std::size_t>& other_hash = hashes_[at->second];
      if (!hash) hash = PixelHash(slice);
      if (!other_hash) other_hash = PixelHash(other);
      if ((hash != other_hash && !AreOneInstance(slice, other)) || !IsOfOnePass(slice, other)) {
        continue;
      }
      left_out->Add("it is a copy of another slice", slice.file);
      return;
    }
    Put(std::move(slice), hash);
  }
  std::vector<DicomSlice>& slices() { return slices_; }
  std::size_t size() const { return slices_.size(); }
  // Of a pass, else empty.
  const std::string& number() const { return number_; }
  const std::string& description() const { return description_; }

 private:
  static std::tuple<double, double, double> Place(const DicomSlice& slice) {
    const Vec3& at = slice.position_W_mm;
    return {at.x(), at.y(), at.z()};
  }
  void Put(DicomSlice slice, std::optional<std::size_t> hash) {
    hashes_.push_back(hash);
    places_.emplace(Place(slice), slices_.size());
    slices_.push_back(std::move(slice));
  }

  std::vector<DicomSlice> slices_;
  std::vector<std::optional<std::size_t>> hashes_;  // of their pixels, once they were compared
  std::string number_, description_;
  std::multimap<std::tuple<double, double, double>, std::size_t> places_;
};

using Series = std::map<std::string, std::vector<Stack>>;  // by a key of the series

std::string SeriesOf(const DicomSlice& slice) { return slice.content.Text(dicom::kSeries); }

// What is left of a series where each file got a SeriesInstanceUID of its own.
std::string LooseSeriesOf(const DicomSlice& slice) {
  std::string key;
  for (const DicomTag& tag :
       {dicom::kStudy, dicom::kFrameOfReference, dicom::kSeriesNumber, dicom::kModality}) {
    key += slice.content.Text(tag) + "\n";
  }
  return key;
}

Series Grouped(std::vector<DicomSlice> slices, std::string (*key)(const DicomSlice&),
               FileNotes* left_out) {
  Series series;
  for (DicomSlice& slice : slices) {
    std::vector<Stack>& stacks = series[key(slice)];
    const auto stack =
        std::ranges::find_if(stacks, [&](const Stack& one) { return one.Takes(slice); });
    if (stack == stacks.end()) {
      stacks.emplace_back(std::move(slice));
    } else {
      stack->Add(std::move(slice), left_out);
    }
  }
  return series;
}

Series SplitByPass(Series series) {
  for (auto& [key, stacks] : series) {
    std::vector<Stack> passes;
    for (Stack& stack : stacks) {
      for (DicomPass& pass : PassesOf(std::move(stack.slices()))) {
        passes.emplace_back(std::move(pass));
      }
    }
    stacks = std::move(passes);
  }
  return series;
}

Stack* LargestOf(Series* series) {
  Stack* largest = nullptr;
  for (auto& [key, stacks] : *series) {
    for (Stack& stack : stacks) {
      if (!largest || stack.size() > largest->size()) largest = &stack;
    }
  }
  return largest;
}

bool HasStack(Series* series) {
  const Stack* const largest = LargestOf(series);
  return largest && largest->size() > 1;
}

void KeepSeries(const std::string& wanted, bool is_last_try, std::vector<DicomSlice>* slices) {
  std::set<std::string> present;
  for (const DicomSlice& slice : *slices) present.insert(SeriesOf(slice));
  if (is_last_try && !present.contains(wanted)) {
    std::string list;
    for (const std::string& uid : present) list += (list.empty() ? "" : ", ") + uid;
    Refuse("no slices of the series " + Quoted(wanted) + "; there are: " + list);
  }
  std::erase_if(*slices, [&](const DicomSlice& slice) { return SeriesOf(slice) != wanted; });
}

// Leaves out all other passes of the series that is taken, and all other series.
void KeepPass(const std::string& wanted, Series* series, FileNotes* left_out) {
  const std::string taken = SeriesOf(LargestOf(series)->slices().front());
  std::set<std::string> present;
  for (auto& [key, stacks] : *series) {
    std::erase_if(stacks, [&](Stack& stack) {
      if (SeriesOf(stack.slices().front()) == taken) return false;
      for (const DicomSlice& slice : stack.slices()) {
        left_out->Add("it is of the series " + SeriesOf(slice), slice.file);
      }
      return true;
    });
    for (const Stack& stack : stacks) present.insert(stack.number());
  }
  present.erase("");
  if (!present.contains(wanted)) {
    std::string list;
    for (const std::string& number : present) list += (list.empty() ? "" : ", ") + number;
    Refuse("there is no pass " + Quoted(wanted) +
           (list.empty() ? ", and only one; leave --acquisition out" : "; there are: " + list));
  }
  for (auto& [key, stacks] : *series) {
    std::erase_if(stacks, [&](const Stack& stack) { return stack.number() != wanted; });
  }
}

std::string Named(const std::string& series, const std::string& description) {
  return "the series " + series + (description.empty() ? "" : " " + Quoted(description));
}

// Lists the first passes of the series.
std::string PassesIn(const std::vector<Stack>& stacks) {
  constexpr std::size_t kMostListed = 8;
  std::string list;
  for (const Stack& stack : stacks) {
    if (stack.number().empty()) continue;
    if (&stack == &stacks[0] + kMostListed) return list + "; ...";
    list += (list.empty() ? "" : "; ") + stack.number() + ": " + stack.description() + ", " +
            std::to_string(stack.size()) + " slices";
  }
  return list;
}

// Takes the slices of the largest stack, and notes the others.
void Choose(Series series, FileNotes* left_out, DicomFolder* result) {
  Stack* const largest = LargestOf(&series);
  const std::string chosen = SeriesOf(largest->slices().front());
  for (auto& [key, stacks] : series) {
    const bool has_chosen = std::ranges::any_of(stacks, [&](Stack& s) { return &s == largest; });
    if (has_chosen && stacks.size() > 1 && !largest->number().empty()) {
      result->warnings.push_back("pass " + largest->number() +
                                 " of several over the same range is taken; palpate-import "
                                 "--acquisition chooses another (" +
                                 PassesIn(stacks) + ")" + kReadOtherwise);
    }
    for (Stack& stack : stacks) {
      if (&stack == largest) continue;
      for (const DicomSlice& slice : stack.slices()) {
        const bool is_other = SeriesOf(slice) != chosen;
        left_out->Add(
            is_other ? "it is of " + Named(SeriesOf(slice), slice.content.Text(dicom::kDescription))
            : has_chosen && stack.Takes(largest->slices().front())
                ? "it is of pass " + stack.number()
                : "it differs from the stack in size, spacing or orientation",
            slice.file);
      }
    }
  }
  result->slices = std::move(largest->slices());
}

constexpr char kLooseSeries[] =
    "each slice has a SeriesInstanceUID of its own; those of one study, frame of reference and "
    "SeriesNumber are taken for one series";

// Says what is taken.
void Describe(const fs::path& folder, bool below, bool several, DicomFolder* result) {
  const DicomSlice& first = result->slices.front();
  if (!result->left_out.empty()) {
    result->warnings.push_back(
        std::to_string(result->slices.size()) + " slices of " +
        Named(SeriesOf(first), first.content.Text(dicom::kDescription)) +
        " are taken, others are left out: " + result->left_out +
        (several ? "; palpate-import --series UID chooses another series" : ""));
  }
  if (below) {
    result->warnings.push_back("the slices lie below the folder, in " +
                               Quoted(fs::relative(first.file.parent_path(), folder).string()));
  }
}

}  // namespace

DicomFolder ScanDicomFolder(const fs::path& folder, const ImportLimits& limits) {
  DicomFolder result;
  Found found;
  Series series;
  FileNotes left_out;
  const auto group = [&](std::string (*key)(const DicomSlice&)) {
    left_out = found.left_out;
    series = Grouped(found.slices, key, &left_out);
    if (limits.acquisition != kAllPasses) series = SplitByPass(std::move(series));
  };
  for (const bool below : {false, true}) {
    found = Find(folder, below, limits);
    if (!limits.series.empty()) KeepSeries(limits.series, below, &found.slices);
    group(SeriesOf);
    const std::size_t count = series.size();
    if (count > 1 && !HasStack(&series)) {
      group(LooseSeriesOf);
      if (HasStack(&series)) result.warnings.push_back(kLooseSeries);
    }
    if (!HasStack(&series)) continue;
    if (!limits.acquisition.empty() && limits.acquisition != kAllPasses) {
      KeepPass(limits.acquisition, &series, &left_out);
    }
    Choose(std::move(series), &left_out, &result);
    result.left_out = left_out.Text();
    Describe(folder, below, count > 1, &result);
    if (!found.repairs.empty()) result.warnings.push_back(found.repairs.Text());
    return result;
  }
  if (found.slices.empty() && found.left_out.empty()) {
    Refuse("neither the folder nor those below hold DICOM slices; give the one with the series");
  }
  if (!found.slices.empty()) Choose(std::move(series), &left_out, &result);
  Refuse((found.slices.empty() ? "no DICOM slice can be used"
                               : "there is a single slice; a volume needs at least two") +
         (left_out.empty() ? std::string() : ": " + left_out.Text()));
}

}  // namespace palpate
