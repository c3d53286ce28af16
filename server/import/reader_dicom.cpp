#include <gdcmTrace.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/import/dicom_folder.h"
#include "server/import/dicom_pixels.h"
#include "server/import/dicom_stack.h"
#include "server/import/readers.h"
#include "server/import/value_checks.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// A slice may be missing because its file was left out.
DicomStack MakeStackOf(DicomFolder folder, const ImportLimits& limits, Reporter* reporter) {
  try {
    return MakeStack(std::move(folder.slices), limits, reporter);
  } catch (const Error& error) {
    if (folder.left_out.empty()) throw;
    throw Error(error.kind(), std::string(error.what()) + " (left out: " + folder.left_out + ")");
  }
}

// Reads slices, and keeps in mind those that hold more than they state.
class StackReader {
 public:
  explicit StackReader(const DicomStack& stack) : stack_(stack) {}

  const std::vector<DicomSlice>& slices() const { return stack_.slices; }
  double height_mm(std::size_t k) const { return stack_.places_mm[k].z(); }
  std::vector<float> Read(std::size_t k) {
    DicomPixels pixels = ReadDicomPixels(stack_.slices[k]);
    if (pixels.takes_all_bits || pixels.has_more_bits) {
      notes_.Add(pixels.takes_all_bits
                     ? "its pixels need more bits than BitsStored says; all are taken"
                     : "there is something in the bits above those of BitsStored; it is left out",
                 stack_.slices[k].file);
    }
    least_padding_ = std::min(least_padding_, pixels.least_padding);
    // What codecs give may be either.
    const bool is_stream = stack_.slices[k].content.stream.bits > 0;
    has_short_signs_ |= pixels.has_short_signs && !is_stream;
    has_long_signs_ |= pixels.has_long_signs && !is_stream;
    if (has_short_signs_ && has_long_signs_) {
      Refuse(
          "the slices contradict each other in the bit of their sign (BitsStored); export the "
          "series again");
    }
    if (pixels.has_short_signs) {
      notes_.Add(std::string("its numbers have their sign in BitsStored") + kReadOtherwise,
                 stack_.slices[k].file);
    }
    return std::move(pixels.values);
  }
  const FileNotes& notes() const { return notes_; }
  float least_padding() const { return least_padding_; }

 private:
  const DicomStack& stack_;
  FileNotes notes_;
  bool has_short_signs_ = false, has_long_signs_ = false;
  float least_padding_ = std::numeric_limits<float>::infinity();
};

// Gives the volume's slices one after the other, interpolated between the stack's.
class Resampler {
 public:
  explicit Resampler(StackReader* stack) : stack_(*stack) { Read(0), Read(1); }

  // `height_mm` must not be less than before.
  const std::vector<float>& At(double height_mm) {
    while (next_ + 1 < stack_.slices().size() && height_mm > Height(next_)) Read(next_ + 1);
    const double share = (height_mm - Height(next_ - 1)) / (Height(next_) - Height(next_ - 1));
    // A slice that lies there stays as it is, whatever was rounded.
    const double rounded = std::round(share);
    const double used =
        std::clamp(std::abs(share - rounded) < kAtSlice ? rounded : share, 0.0, 1.0);
    if (used == 0.0) return below_;
    if (used == 1.0) return above_;
    for (std::size_t n = 0; n < between_.size(); ++n) {
      between_[n] = std::lerp(below_[n], above_[n], static_cast<float>(used));
    }
    return between_;
  }

 private:
  static constexpr double kAtSlice = 1e-6;

  double Height(std::size_t k) const { return stack_.height_mm(k); }
  void Read(std::size_t k) {
    below_.swap(above_);
    next_ = k;
    above_ = stack_.Read(k);
    between_.resize(above_.size());
  }

  StackReader& stack_;
  std::size_t next_ = 0;  // the slice in above_; the one before is in below_
  std::vector<float> below_, above_, between_;
};

void ReadStack(const DicomStack& stack, const ImportLimits& limits, const VoxelSink& sink,
               Reporter* reporter) {
  StackReader slices(stack);
  std::optional<Resampler> resampler;
  if (stack.is_resampled) resampler.emplace(&slices);
  for (std::int64_t k = 0; k < stack.count; ++k) {
    reporter->Progress(0.1 + 0.7 * static_cast<double>(k) / static_cast<double>(stack.count),
                       "reading");
    const std::vector<float> slice =
        resampler ? resampler->At(stack.first_mm.z() + static_cast<double>(k) * stack.pitch_mm)
                  : slices.Read(static_cast<std::size_t>(k));
    sink(LeafType::kFloat, slice.data(), slice.size());
  }
  if (limits.on_padding) limits.on_padding(slices.least_padding());
  if (!slices.notes().empty()) reporter->Warn(slices.notes().Text());
}

VolumeMetadata MakeMetadata(const DicomStack& stack) {
  const DicomSlice& first = stack.slices.front();
  VolumeMetadata metadata;
  metadata.size = {static_cast<int>(first.size[0]), static_cast<int>(first.size[1]),
                   static_cast<int>(stack.count)};
  metadata.spacing_mm = {first.spacing_mm[0], first.spacing_mm[1], stack.pitch_mm};
  metadata.origin_W_mm = stack.direction * stack.first_mm;
  metadata.direction = stack.direction;
  if (first.order.empty()) metadata.patient_axes = "LPS";
  metadata.original_type = Name(first.type);
  const bool is_one_unit = std::ranges::all_of(
      stack.slices, [&](const DicomSlice& slice) { return slice.unit == first.unit; });
  if (is_one_unit) metadata.unit = first.unit;
  // Each slice may have its own. That of the middle is of the body, not of the air above it.
  const DicomSlice& middle = stack.slices[stack.slices.size() / 2];
  metadata.window_level = middle.window_level;
  metadata.window_width = middle.window_width;
  return metadata;
}

}  // namespace

VolumeMetadata ReadDicomVolume(const fs::path& folder, const ImportLimits& limits,
                               const VoxelSink& sink, Reporter* reporter) {
  gdcm::Trace::DebugOff();
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  reporter->Progress(0.0, "scanning");
  DicomFolder found = ScanDicomFolder(folder, limits);
  for (const std::string& warning : found.warnings) reporter->Warn(warning);
  const DicomStack stack = MakeStackOf(std::move(found), limits, reporter);
  const DicomSlice& first = stack.slices.front();
  const auto size = VolumeSize({first.size[0], first.size[1], stack.count});
  CheckedVoxelBytes(size, first.type, LeafType::kFloat, limits);
  HounsfieldCheck check;
  ReadStack(stack, limits, check.Watching(sink), reporter);
  VolumeMetadata metadata = MakeMetadata(stack);
  if (limits.rescale) {
    if (first.is_ct) metadata.unit = "HU";
  } else {
    check.Judge(first.is_ct, first.intercept != 0.0, &metadata.unit, reporter);
  }
  return metadata;
}

}  // namespace palpate
