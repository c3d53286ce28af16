#include <itkGDCMImageIO.h>
#include <itkImage.h>
#include <itkImageFileReader.h>

#include <gdcmScanner.h>
#include <gdcmTrace.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/import/data_check.h"
#include "server/import/dicom_file.h"
#include "server/import/dicom_stack.h"
#include "server/import/file_start.h"
#include "server/import/readers.h"
#include "server/volume/volume_metadata.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

using Image = itk::Image<float, 3>;

const gdcm::Tag kModality(0x0008, 0x0060);
const gdcm::Tag kSeries(0x0020, 0x000e);
const gdcm::Tag kPosition(0x0020, 0x0032);
const gdcm::Tag kOrientation(0x0020, 0x0037);
const gdcm::Tag kFrames(0x0028, 0x0008);
const gdcm::Tag kSamples(0x0028, 0x0002);
const gdcm::Tag kRows(0x0028, 0x0010);
const gdcm::Tag kColumns(0x0028, 0x0011);
const gdcm::Tag kPixelSpacing(0x0028, 0x0030);
const gdcm::Tag kBits(0x0028, 0x0100);
const gdcm::Tag kSign(0x0028, 0x0103);
const gdcm::Tag kIntercept(0x0028, 0x1052);
const gdcm::Tag kSlope(0x0028, 0x1053);
const gdcm::Tag kRescaleType(0x0028, 0x1054);

constexpr double kFarthest_mm = 1e9;
constexpr std::int64_t kMostCopied = std::int64_t{256} << 20;

// The text of a tag in one file; empty if the tag is absent.
class Tags {
 public:
  Tags(const gdcm::Scanner& scanner, std::string file)
      : scanner_(scanner), file_(std::move(file)) {}
  std::string Text(const gdcm::Tag& tag) const {
    const char* value = scanner_.GetValue(file_.c_str(), tag);
    return value ? std::string(Trim(value)) : std::string();
  }
  // Numbers of "a\b\c"; empty unless there are `count` finite numbers.
  std::vector<double> Numbers(const gdcm::Tag& tag, std::size_t count) const {
    std::string text = Text(tag);
    std::replace(text.begin(), text.end(), '\\', ' ');
    std::vector<double> numbers;
    for (const std::string_view word : Words(text)) {
      numbers.push_back(ParseReal(word, "DICOM tag"));
      if (!std::isfinite(numbers.back())) return {};
    }
    return numbers.size() == count ? numbers : std::vector<double>();
  }
  double Number(const gdcm::Tag& tag, double absent) const {
    const std::vector<double> numbers = Numbers(tag, 1);
    return numbers.empty() ? absent : numbers[0];
  }
  const std::string& file() const { return file_; }

 private:
  const gdcm::Scanner& scanner_;
  std::string file_;
};

ScalarType ParseType(const Tags& tags) {
  const double bits = tags.Number(kBits, 16);
  const bool is_signed = tags.Number(kSign, 0) == 1;
  if (bits <= 8) return is_signed ? ScalarType::kInt8 : ScalarType::kUint8;
  if (bits <= 16) return is_signed ? ScalarType::kInt16 : ScalarType::kUint16;
  return is_signed ? ScalarType::kInt32 : ScalarType::kUint32;
}

// The rescale of a CT leads to Hounsfield units unless its type says otherwise. US: unspecified.
std::string ParseUnit(const Tags& tags) {
  const std::string type = tags.Text(kRescaleType);
  if (!type.empty()) return type == "US" ? "" : type;
  const bool is_rescaled = !tags.Text(kIntercept).empty() && !tags.Text(kSlope).empty();
  return tags.Text(kModality) == "CT" && is_rescaled ? "HU" : "";
}

DicomSlice ParseSlice(const Tags& tags) {
  const auto position = tags.Numbers(kPosition, 3);
  const auto orientation = tags.Numbers(kOrientation, 6);
  const auto spacing = tags.Numbers(kPixelSpacing, 2);
  DicomSlice slice;
  slice.file = tags.file();
  const std::string name = "the slice " + FileName(slice.file);
  if (position.empty() || orientation.empty() || spacing.empty()) {
    Refuse(name + " does not state its position, orientation and pixel spacing; export it again");
  }
  if (tags.Number(kFrames, 1) > 1) {
    Refuse(name + " has several frames, which is not supported; save one file per slice");
  }
  if (tags.Number(kSamples, 1) > 1) Refuse(name + " is a colour image; choose a grey series");
  slice.position_W_mm = {position[0], position[1], position[2]};
  if (slice.position_W_mm.cwiseAbs().maxCoeff() > kFarthest_mm) {
    Refuse(name + " states a position that is none; export it again");
  }
  slice.row_W = {orientation[0], orientation[1], orientation[2]};
  slice.column_W = {orientation[3], orientation[4], orientation[5]};
  if (std::abs(slice.row_W.norm() - 1.0) > kParallelSlices ||
      std::abs(slice.column_W.norm() - 1.0) > kParallelSlices ||
      std::abs(slice.row_W.dot(slice.column_W)) > kParallelSlices) {
    Refuse(name + " has an orientation that is not made of unit vectors; export it again");
  }
  slice.row_W.normalize();
  slice.column_W = (slice.column_W - slice.row_W * slice.row_W.dot(slice.column_W)).normalized();
  // DICOM gives the distance of rows first, which is along y.
  slice.spacing_mm = {spacing[1], spacing[0]};
  for (const double mm : slice.spacing_mm) CheckSpacing(mm);
  slice.size = {static_cast<std::int64_t>(tags.Number(kColumns, 0)),
                static_cast<std::int64_t>(tags.Number(kRows, 0))};
  slice.type = ParseType(tags);
  slice.unit = ParseUnit(tags);
  slice.is_ct = tags.Text(kModality) == "CT";
  return slice;
}

// Refuses damaged DICOM files, so that GDCM does not see them.
DicomFile Checked(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return {};
  try {
    return CheckDicomFile(&in, static_cast<std::int64_t>(fs::file_size(file)));
  } catch (const Error& error) {
    throw Error(error.kind(), "in " + FileName(file) + " " + error.what());
  }
}

std::vector<std::string> ImageFiles(const fs::path& folder, const ImportLimits& limits) {
  std::vector<std::string> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (!entry->is_regular_file() || limits.own_files.Hold(entry->path())) continue;
    CheckPlace(entry->path(), limits);
    if (Checked(entry->path()).has_pixels) files.push_back(entry->path().string());
  }
  if (error == std::errc::permission_denied) {
    throw Error(ErrorKind::kPermissionDenied,
                "the folder may not be read; give this user the permission");
  }
  if (error) Refuse("the folder cannot be read: " + error.message());
  std::sort(files.begin(), files.end());
  return files;
}

// Returns the slices of the largest series.
std::vector<DicomSlice> ScanFolder(const fs::path& folder, const ImportLimits& limits,
                                   Reporter* reporter) {
  const std::vector<std::string> files = ImageFiles(folder, limits);
  if (files.empty()) Refuse("the folder holds no DICOM slices; give the one with the series");
  gdcm::SmartPointer<gdcm::Scanner> scanner = new gdcm::Scanner;
  for (const gdcm::Tag& tag :
       {kModality, kSeries, kPosition, kOrientation, kFrames, kSamples, kRows, kColumns,
        kPixelSpacing, kBits, kSign, kIntercept, kSlope, kRescaleType}) {
    scanner->AddTag(tag);
  }
  if (!scanner->Scan(files)) Refuse("the folder holds no DICOM series that can be read");

  std::map<std::string, std::vector<Tags>> series;
  bool frames = false;
  for (const std::string& file : files) {
    const Tags tags(*scanner, file);
    if (!scanner->IsKey(file.c_str()) || tags.Text(kRows).empty()) continue;
    // A file with many frames has no position of its own, so it is not a slice.
    frames = frames || tags.Number(kFrames, 1) > 1;
    if (!tags.Text(kPosition).empty()) series[tags.Text(kSeries)].push_back(tags);
  }
  if (series.empty()) {
    Refuse(frames ? "DICOM files with several frames are not supported; save one file per slice"
                  : "the folder holds no DICOM slices; give the one with the series");
  }
  const auto largest = std::max_element(
      series.begin(), series.end(),
      [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  if (series.size() > 1) {
    reporter->Warn("the folder holds " + std::to_string(series.size()) +
                   " DICOM series; the one with the most slices is taken (" +
                   std::to_string(largest->second.size()) + " slices, " + largest->first + ")");
  }
  std::vector<DicomSlice> slices;
  for (const Tags& tags : largest->second) slices.push_back(ParseSlice(tags));
  return slices;
}

// GDCM takes padding after the pixels for elements of eight bytes, reads each by itself, and
// crashes if some bytes remain. Files above kMostCopied are no slices of a scanner.
std::optional<FileStart> WithoutPadding(const fs::path& file) {
  const std::int64_t end = Checked(file).pixels_end;
  if (end == static_cast<std::int64_t>(fs::file_size(file)) || end > kMostCopied) return {};
  return std::optional<FileStart>(std::in_place, file, end);
}

void ReadSlice(const DicomSlice& slice, const VoxelSink& sink) {
  const std::optional<FileStart> start = WithoutPadding(slice.file);
  const auto io = itk::GDCMImageIO::New();
  const auto reader = itk::ImageFileReader<Image>::New();
  reader->SetImageIO(io);
  reader->SetFileName(start ? start->path().string() : slice.file.string());
  reader->UpdateOutputInformation();
  const auto size = reader->GetOutput()->GetLargestPossibleRegion().GetSize();
  if (io->GetNumberOfComponents() != 1 || size[2] != 1 ||
      static_cast<std::int64_t>(size[0]) != slice.size[0] ||
      static_cast<std::int64_t>(size[1]) != slice.size[1]) {
    Refuse("the slice " + FileName(slice.file) + " is not what its header says; export it again");
  }
  reader->Update();
  sink(LeafType::kFloat, reader->GetOutput()->GetBufferPointer(), size[0] * size[1]);
}

void ReadWhole(const DicomSlice& slice, const VoxelSink& sink) {
  try {
    ReadSlice(slice, sink);
  } catch (const itk::ExceptionObject&) {
    Refuse("the slice " + FileName(slice.file) +
           " is damaged or incomplete; copy or export it again");
  }
}

// Gives the volume's slices one after the other, interpolated between the stack's.
class Resampler {
 public:
  explicit Resampler(const DicomStack& stack) : stack_(stack) { Read(0), Read(1); }

  // `height_mm` must not be less than before.
  const std::vector<float>& At(double height_mm) {
    while (next_ + 1 < stack_.slices.size() && height_mm > Height(next_)) Read(next_ + 1);
    const double share = (height_mm - Height(next_ - 1)) / (Height(next_) - Height(next_ - 1));
    // A slice that lies there stays as it is, whatever was rounded.
    const double rounded = std::round(share);
    const double used =
        std::clamp(std::abs(share - rounded) < kAtSlice ? rounded : share, 0.0, 1.0);
    for (std::size_t n = 0; n < between_.size(); ++n) {
      between_[n] = std::lerp(below_[n], above_[n], static_cast<float>(used));
    }
    return between_;
  }

 private:
  static constexpr double kAtSlice = 1e-6;

  double Height(std::size_t k) const { return stack_.places_mm[k].z(); }
  void Read(std::size_t k) {
    below_.swap(above_);
    next_ = k;
    ReadWhole(stack_.slices[k], [this](LeafType, const void* voxels, std::size_t count) {
      const auto* const floats = static_cast<const float*>(voxels);
      above_.assign(floats, floats + count);
    });
    between_.resize(above_.size());
  }

  const DicomStack& stack_;
  std::size_t next_ = 0;  // the slice in above_; the one before is in below_
  std::vector<float> below_, above_, between_;
};

void ReadStack(const DicomStack& stack, const VoxelSink& sink, Reporter* reporter) {
  std::optional<Resampler> resampler;
  if (stack.is_resampled) resampler.emplace(stack);
  for (std::int64_t k = 0; k < stack.count; ++k) {
    reporter->Progress(0.1 + 0.7 * static_cast<double>(k) / static_cast<double>(stack.count),
                       "reading");
    if (!resampler) {
      ReadWhole(stack.slices[static_cast<std::size_t>(k)], sink);
      continue;
    }
    const std::vector<float>& slice =
        resampler->At(stack.first_mm.z() + static_cast<double>(k) * stack.pitch_mm);
    sink(LeafType::kFloat, slice.data(), slice.size());
  }
}

VolumeMetadata MakeMetadata(const DicomStack& stack) {
  const DicomSlice& first = stack.slices.front();
  VolumeMetadata metadata;
  metadata.size = {static_cast<int>(first.size[0]), static_cast<int>(first.size[1]),
                   static_cast<int>(stack.count)};
  metadata.spacing_mm = {first.spacing_mm[0], first.spacing_mm[1], stack.pitch_mm};
  metadata.origin_W_mm = stack.direction * stack.first_mm;
  metadata.direction = stack.direction;
  metadata.patient_axes = "LPS";
  metadata.original_type = Name(first.type);
  const bool is_one_unit = std::ranges::all_of(
      stack.slices, [&](const DicomSlice& slice) { return slice.unit == first.unit; });
  if (is_one_unit) metadata.unit = first.unit;
  return metadata;
}

}  // namespace

VolumeMetadata ReadDicomVolume(const fs::path& folder, const ImportLimits& limits,
                               const VoxelSink& sink, Reporter* reporter) {
  gdcm::Trace::DebugOff();
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  reporter->Progress(0.0, "scanning");
  const DicomStack stack = MakeStack(ScanFolder(folder, limits, reporter), limits, reporter);
  const DicomSlice& first = stack.slices.front();
  const auto size = VolumeSize({first.size[0], first.size[1], stack.count});
  CheckedVoxelBytes(size, first.type, LeafType::kFloat, limits);
  ReadStack(stack, sink, reporter);
  VolumeMetadata metadata = MakeMetadata(stack);
  if (first.is_ct && metadata.unit.empty()) {
    reporter->Warn(
        "this CT does not say how its values lead to Hounsfield units: they have no unit, and no "
        "value stands for bone or skin");
  }
  return metadata;
}

}  // namespace palpate
