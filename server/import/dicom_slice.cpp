#include "server/import/dicom_slice.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace palpate {
namespace {

constexpr double kFarthest_mm = 1e9;

class Fields {
 public:
  Fields(const std::filesystem::path& file, const DicomFile& content, FileNotes* repairs)
      : file_(file), content_(content), repairs_(repairs) {}

  std::string Text(const DicomTag& tag) const { return content_.Text(tag); }
  // Numbers of "a\b\c"; empty unless there are `count` finite numbers.
  std::vector<double> Numbers(const DicomTag& tag, std::size_t count) const {
    std::string text = Text(tag);
    std::ranges::replace(text, '\\', ' ');
    // No comma belongs into a number, but some programs write one for the point.
    if (text.find(',') != std::string::npos) {
      std::ranges::replace(text, ',', '.');
      repairs_->Add(std::string("a comma is read as the decimal point in ") + tag.name, file_);
    }
    std::vector<double> numbers;
    for (const std::string_view word : Words(text)) {
      numbers.push_back(ParseReal(word, tag.name));
      if (!std::isfinite(numbers.back())) return {};
    }
    return numbers.size() == count ? numbers : std::vector<double>();
  }
  double Number(const DicomTag& tag, double absent) const {
    const std::vector<double> numbers = Numbers(tag, 1);
    return numbers.empty() ? absent : numbers[0];
  }

 private:
  const std::filesystem::path& file_;
  const DicomFile& content_;
  FileNotes* repairs_;
};

ScalarType ParseType(const Fields& fields) {
  const double bits = fields.Number(dicom::kBits, 16);
  const bool is_signed = fields.Number(dicom::kSign, 0) == 1;
  if (bits <= 8) return is_signed ? ScalarType::kInt8 : ScalarType::kUint8;
  if (bits <= 16) return is_signed ? ScalarType::kInt16 : ScalarType::kUint16;
  return is_signed ? ScalarType::kInt32 : ScalarType::kUint32;
}

// The rescale of a CT leads to Hounsfield units unless its type says otherwise. US: unspecified.
std::string ParseUnit(const Fields& fields, const DicomFile& content) {
  const std::string type = content.table ? content.table->type : fields.Text(dicom::kRescaleType);
  if (!type.empty()) return type == "US" ? "" : type;
  const bool is_rescaled =
      !fields.Text(dicom::kIntercept).empty() && !fields.Text(dicom::kSlope).empty();
  return fields.Text(dicom::kModality) == "CT" && is_rescaled ? "HU" : "";
}

// A file may propose several windows, "40\\400". A bad one is left out: it is for pictures only.
double FirstNumber(const std::string& text) {
  const double number = std::strtod(text.c_str(), nullptr);
  return std::isfinite(number) ? number : 0.0;
}

void CheckKind(const Fields& fields) {
  if (fields.Number(dicom::kFrames, 1) > 1) {
    Refuse("it has several frames, which is not supported; save one file per slice");
  }
  const std::string colours = fields.Text(dicom::kPhotometric);
  if (fields.Number(dicom::kSamples, 1) > 1 ||
      (!colours.empty() && !colours.starts_with("MONOCHROME"))) {
    Refuse("it is a colour image; choose a grey series");
  }
}

void ParsePlace(const Fields& fields, DicomSlice* slice) {
  const auto position = fields.Numbers(dicom::kPosition, 3);
  const auto orientation = fields.Numbers(dicom::kOrientation, 6);
  if (position.empty() || orientation.empty()) {
    Refuse("it does not state its position and orientation; export it again");
  }
  slice->position_W_mm = {position[0], position[1], position[2]};
  if (slice->position_W_mm.cwiseAbs().maxCoeff() > kFarthest_mm) {
    Refuse("it states a position that is none; export it again");
  }
  slice->row_W = {orientation[0], orientation[1], orientation[2]};
  slice->column_W = {orientation[3], orientation[4], orientation[5]};
  if (std::abs(slice->row_W.norm() - 1.0) > kParallelSlices ||
      std::abs(slice->column_W.norm() - 1.0) > kParallelSlices ||
      std::abs(slice->row_W.dot(slice->column_W)) > kParallelSlices) {
    Refuse("it has an orientation that is not made of unit vectors; export it again");
  }
  slice->row_W.normalize();
  slice->column_W =
      (slice->column_W - slice->row_W * slice->row_W.dot(slice->column_W)).normalized();
}

// DICOM gives the distance of rows first, which is along y.
std::array<double, 2> ParseSpacing(const Fields& fields) {
  const auto spacing = fields.Numbers(dicom::kPixelSpacing, 2);
  if (spacing.empty()) {
    Refuse("it does not state its PixelSpacing; export it again, or give --spacing-mm X,Y,Z");
  }
  for (const double mm : spacing) CheckSpacing(mm);
  return {spacing[1], spacing[0]};
}

}  // namespace

std::string FileNotes::Text() const {
  constexpr std::size_t kMostNames = 3;
  std::string text;
  for (const auto& [what, files] : files_) {
    text += text.empty() ? "" : "; ";
    for (std::size_t k = 0; k < std::min(files.size(), kMostNames); ++k) {
      text += (k == 0 ? "" : ", ") + files[k];
    }
    if (files.size() > kMostNames) text += " ... (" + std::to_string(files.size()) + " files)";
    text += ": " + what;
  }
  return text;
}

DicomSlice ParseSlice(const std::filesystem::path& file, DicomFile content,
                      const ImportLimits& limits, FileNotes* repairs) {
  DicomSlice slice;
  slice.file = file;
  const Fields fields(slice.file, content, repairs);
  CheckKind(fields);
  ParsePlace(fields, &slice);
  slice.spacing_mm = limits.spacing_is_given ? std::array{1.0, 1.0} : ParseSpacing(fields);
  slice.size = {static_cast<std::int64_t>(fields.Number(dicom::kColumns, 0)),
                static_cast<std::int64_t>(fields.Number(dicom::kRows, 0))};
  slice.type = ParseType(fields);
  slice.intercept = fields.Number(dicom::kIntercept, 0.0);
  slice.slope = fields.Number(dicom::kSlope, 1.0);
  if (slice.slope == 0.0) slice.slope = 1.0;  // as GDCM
  slice.unit = ParseUnit(fields, content);
  slice.window_level = FirstNumber(fields.Text(dicom::kWindowLevel));
  slice.window_width = std::max(0.0, FirstNumber(fields.Text(dicom::kWindowWidth)));
  slice.is_ct = fields.Text(dicom::kModality) == "CT";
  slice.content = std::move(content);
  return slice;
}

}  // namespace palpate
