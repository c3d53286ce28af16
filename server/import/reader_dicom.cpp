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
const gdcm::Tag kRescaleType(0x0028, 0x1054);

// Relative difference of a pitch from the median: up to kEvenPitch without a warning. From
// kMissingSlice times the median on, a slice is missing.
constexpr double kEvenPitch = 0.01;
constexpr double kMissingSlice = 1.5;
// Tolerance for the unit vectors along rows and columns.
constexpr double kParallel = 1e-3;
// Sideways drift of the stack per length; more is a gantry tilt.
constexpr double kStraight = 0.01;
constexpr std::int64_t kMostCopied = std::int64_t{256} << 20;

struct Slice {
  fs::path file;
  Vec3 position_W_mm;
  Vec3 row_W;     // unit vector along x
  Vec3 column_W;  // unit vector along y
  std::array<double, 2> spacing_mm{};
  std::array<std::int64_t, 2> size{};
  ScalarType type = ScalarType::kInt16;
  std::string unit;
};

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

std::string ParseUnit(const Tags& tags) {
  const std::string type = tags.Text(kRescaleType);
  if (tags.Text(kModality) == "CT") return type.empty() || type == "US" ? "HU" : type;
  return type == "US" ? "" : type;  // US: unspecified
}

std::string FileName(const fs::path& file) { return Quoted(file.filename().string()); }

Slice ParseSlice(const Tags& tags) {
  const auto position = tags.Numbers(kPosition, 3);
  const auto orientation = tags.Numbers(kOrientation, 6);
  const auto spacing = tags.Numbers(kPixelSpacing, 2);
  Slice slice;
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
  slice.row_W = {orientation[0], orientation[1], orientation[2]};
  slice.column_W = {orientation[3], orientation[4], orientation[5]};
  if (std::abs(slice.row_W.norm() - 1.0) > kParallel ||
      std::abs(slice.column_W.norm() - 1.0) > kParallel ||
      std::abs(slice.row_W.dot(slice.column_W)) > kParallel) {
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
std::vector<Slice> ScanFolder(const fs::path& folder, const ImportLimits& limits,
                              Reporter* reporter) {
  const std::vector<std::string> files = ImageFiles(folder, limits);
  if (files.empty()) Refuse("the folder holds no DICOM slices; give the one with the series");
  gdcm::SmartPointer<gdcm::Scanner> scanner = new gdcm::Scanner;
  for (const gdcm::Tag& tag : {kModality, kSeries, kPosition, kOrientation, kFrames, kSamples,
                               kRows, kColumns, kPixelSpacing, kBits, kSign, kRescaleType}) {
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
  std::vector<Slice> slices;
  for (const Tags& tags : largest->second) slices.push_back(ParseSlice(tags));
  return slices;
}

// Sorts the slices along their normal and returns the mean pitch.
double SortSlices(std::vector<Slice>* slices, Reporter* reporter) {
  const Slice first = slices->front();
  const Vec3 normal_W = first.row_W.cross(first.column_W);
  for (const Slice& slice : *slices) {
    if (slice.size != first.size || (slice.row_W - first.row_W).norm() > kParallel ||
        (slice.column_W - first.column_W).norm() > kParallel ||
        std::abs(slice.spacing_mm[0] / first.spacing_mm[0] - 1.0) > kParallel ||
        std::abs(slice.spacing_mm[1] / first.spacing_mm[1] - 1.0) > kParallel) {
      Refuse("the slices " + FileName(first.file) + " and " + FileName(slice.file) +
             " differ in size, spacing or orientation; keep those of one stack");
    }
  }
  const auto height = [&](const Slice& slice) { return normal_W.dot(slice.position_W_mm); };
  std::sort(slices->begin(), slices->end(),
            [&](const Slice& a, const Slice& b) { return height(a) < height(b); });
  if (slices->size() < 2) Refuse("there is a single slice; a volume needs at least two");

  std::vector<double> pitches;
  for (std::size_t k = 1; k < slices->size(); ++k) {
    pitches.push_back(height((*slices)[k]) - height((*slices)[k - 1]));
  }
  std::vector<double> sorted = pitches;
  std::sort(sorted.begin(), sorted.end());
  // Takes the lower of two middle values, so that a gap is found even if it is half of all pitches.
  const double median = sorted[(sorted.size() - 1) / 2];
  for (std::size_t k = 0; k < pitches.size(); ++k) {
    const std::string pair =
        FileName((*slices)[k].file) + " and " + FileName((*slices)[k + 1].file);
    if (pitches[k] < 0.1 * median || median < kLeastSpacingMm) {
      Refuse("the slices " + pair + " lie at the same place; keep one phase of the series");
    }
    if (pitches[k] > kMissingSlice * median) {
      Refuse("a slice is missing between " + pair + " (" + std::to_string(pitches[k]) +
             " mm instead of " + std::to_string(median) + " mm); export the series again");
    }
  }
  if (sorted.back() > (1.0 + kEvenPitch) * median || sorted.front() < (1.0 - kEvenPitch) * median) {
    reporter->Warn("the slices are unevenly spaced, " + std::to_string(sorted.front()) + " to " +
                   std::to_string(sorted.back()) + " mm; their mean is taken");
  }
  const Vec3 along_W = slices->back().position_W_mm - slices->front().position_W_mm;
  const double length = normal_W.dot(along_W);
  if ((along_W - normal_W * length).norm() > kStraight * length) {
    Refuse("the stack is tilted against its slices (gantry tilt); resample it first");
  }
  return length / static_cast<double>(pitches.size());
}

// GDCM takes padding after the pixels for elements of eight bytes, reads each by itself, and
// crashes if some bytes remain. Files above kMostCopied are no slices of a scanner.
std::optional<FileStart> WithoutPadding(const fs::path& file) {
  const std::int64_t end = Checked(file).pixels_end;
  if (end == static_cast<std::int64_t>(fs::file_size(file)) || end > kMostCopied) return {};
  return std::optional<FileStart>(std::in_place, file, end);
}

void ReadSlice(const Slice& slice, const VoxelSink& sink) {
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

VolumeMetadata MakeMetadata(const std::vector<Slice>& slices, double pitch_mm) {
  const Slice& first = slices.front();
  VolumeMetadata metadata;
  metadata.size = {static_cast<int>(first.size[0]), static_cast<int>(first.size[1]),
                   static_cast<int>(slices.size())};
  metadata.spacing_mm = {first.spacing_mm[0], first.spacing_mm[1], pitch_mm};
  metadata.origin_W_mm = first.position_W_mm;
  metadata.direction.col(0) = first.row_W;
  metadata.direction.col(1) = first.column_W;
  metadata.direction.col(2) = first.row_W.cross(first.column_W);
  metadata.original_type = Name(first.type);
  metadata.unit = first.unit;
  return metadata;
}

}  // namespace

VolumeMetadata ReadDicomVolume(const fs::path& folder, const ImportLimits& limits,
                               const VoxelSink& sink, Reporter* reporter) {
  gdcm::Trace::DebugOff();
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  reporter->Progress(0.0, "scanning");
  std::vector<Slice> slices = ScanFolder(folder, limits, reporter);
  const double pitch_mm = SortSlices(&slices, reporter);
  const auto size = VolumeSize(
      {slices.front().size[0], slices.front().size[1], static_cast<std::int64_t>(slices.size())});
  CheckedVoxelBytes(size, slices.front().type, LeafType::kFloat, limits);

  for (std::size_t k = 0; k < slices.size(); ++k) {
    const double done = static_cast<double>(k) / static_cast<double>(slices.size());
    reporter->Progress(0.1 + 0.7 * done, "reading");
    try {
      ReadSlice(slices[k], sink);
    } catch (const itk::ExceptionObject&) {
      Refuse("the slice " + FileName(slices[k].file) +
             " is damaged or incomplete; copy or export it again");
    }
  }
  return MakeMetadata(slices, pitch_mm);
}

}  // namespace palpate
