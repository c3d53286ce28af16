#include "server/import/dicom_slice.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace palpate {
namespace {

constexpr double kFarthest_mm = 1e9;
constexpr double kAboutUnit = 0.05;

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
      Repair(std::string("a comma is read as the decimal point in ") + tag.name);
    }
    std::vector<double> numbers;
    for (const std::string_view word : Words(text)) {
      numbers.push_back(ParseReal(word, tag.name));
      if (!std::isfinite(numbers.back())) return {};
    }
    return numbers.size() == count ? numbers : std::vector<double>();
  }
  // Of a field beside others that say the same: text is as good as nothing.
  std::vector<double> NumbersOrNone(const DicomTag& tag, std::size_t count) const {
    try {
      return Numbers(tag, count);
    } catch (const Error&) {
      return {};
    }
  }
  double Number(const DicomTag& tag, double absent) const {
    const std::vector<double> numbers = Numbers(tag, 1);
    return numbers.empty() ? absent : numbers[0];
  }
  int Integer(const DicomTag& tag, int absent) const {
    constexpr double kMost = 1e9;
    return static_cast<int>(std::clamp(Number(tag, absent), -kMost, kMost));
  }
  void Repair(const std::string& what) const { repairs_->Add(what, file_); }

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

// JPEG 2000, JPEG-LS and JPEG say themselves how many bits they hold.
void ParseBits(const Fields& fields, const DicomStream& stream, DicomSlice* slice) {
  const int allocated = fields.Integer(dicom::kBits, 16);
  const int stored = fields.Integer(dicom::kBitsStored, allocated);
  const int high = fields.Integer(dicom::kHighBit, stored - 1);
  slice->is_signed = fields.Integer(dicom::kSign, 0) == 1;
  slice->bits = stored;
  slice->low_bit = high + 1 - stored;
  if (stored < 1 || slice->low_bit < 0 || high >= allocated) {
    slice->bits = allocated;
    slice->low_bit = 0;
    fields.Repair("BitsStored and HighBit contradict BitsAllocated, whose bits are all taken");
  }
  if (stream.bits == 0) return;
  slice->low_bit = 0;
  // Streams of more bits are common, with nothing in those that are not stored.
  if (stream.bits < slice->bits) {
    fields.Repair("its compressed pixels are of " + std::to_string(stream.bits) +
                  " bits, and BitsStored says " + std::to_string(stored) +
                  "; those of the pixels are taken");
    slice->bits = stream.bits;
  }
  if (stream.is_jpeg_2000 && stream.is_signed != slice->is_signed) {
    slice->is_signed = true;
    fields.Repair(std::string("its JPEG 2000 says ") + (stream.is_signed ? "signed" : "unsigned") +
                  " pixels, and PixelRepresentation the contrary; signed ones are taken" +
                  kReadOtherwise);
  }
}

// Its type may be signed or not, whatever the pixels are: the pattern of its bits counts.
void ParsePadding(const Fields& fields, DicomSlice* slice) {
  if (fields.Text(dicom::kPadding).empty()) return;
  const bool is_wide = fields.Integer(dicom::kBits, 16) > 16;
  const auto value = [&](const DicomTag& tag) -> std::int64_t {
    const auto pattern = static_cast<std::uint32_t>(fields.Number(tag, 0));
    if (!slice->is_signed) return pattern;
    return is_wide ? static_cast<std::int32_t>(pattern) : static_cast<std::int16_t>(pattern);
  };
  const std::int64_t one = value(dicom::kPadding);
  const bool has_limit = !fields.Text(dicom::kPaddingLimit).empty();
  const std::int64_t other = has_limit ? value(dicom::kPaddingLimit) : one;
  slice->least_padding = std::min(one, other);
  slice->greatest_padding = std::max(one, other);
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
  if (fields.Text(dicom::kImageType).find("MOSAIC") != std::string::npos) {
    Refuse(
        "it is a mosaic, many slices in one picture, as Siemens writes them, which is not "
        "supported; convert the series with dcm2niix");
  }
  if (fields.Number(dicom::kFrames, 1) > 1) {
    Refuse("it has several frames, which is not supported; save one file per slice");
  }
  const std::string colours = fields.Text(dicom::kPhotometric);
  if (fields.Number(dicom::kSamples, 1) > 1 ||
      (!colours.empty() && !colours.starts_with("MONOCHROME"))) {
    Refuse("it is a colour image; choose a grey series");
  }
}

void CheckPosition(const DicomSlice& slice) {
  if (slice.position_W_mm.cwiseAbs().maxCoeff() > kFarthest_mm) {
    Refuse("it states a position farther than 1e9 mm; export it again");
  }
}

// Of a slice that states no place in the patient: its place among the others.
void ParseOrder(const Fields& fields, const ImportLimits& limits, DicomSlice* slice) {
  auto location = fields.NumbersOrNone(dicom::kSliceLocation, 1);
  const auto number = fields.NumbersOrNone(dicom::kInstanceNumber, 1);
  const auto position = fields.NumbersOrNone(dicom::kPosition, 3);
  slice->order = !location.empty()   ? dicom::kSliceLocation.name
                 : !position.empty() ? dicom::kPosition.name
                                     : dicom::kInstanceNumber.name;
  if (location.empty() && !position.empty()) location = {position[2]};  // as most slices lie
  if (location.empty() && number.empty()) {
    Refuse("it does not state its position and orientation; export it again");
  }
  double pitch_mm = 1.0;
  if (location.empty() && !limits.spacing_is_given) {
    pitch_mm = fields.Number(dicom::kSlicePitch, 0.0);
    if (!(pitch_mm > 0.0)) {
      Refuse(
          "it does not state where it lies, by position and orientation, nor how far slices are "
          "apart (SpacingBetweenSlices); give --spacing-mm X,Y,Z");
    }
  }
  slice->position_W_mm = {0.0, 0.0, location.empty() ? pitch_mm * number[0] : location[0]};
  CheckPosition(*slice);
  slice->row_W = Vec3::UnitX();
  slice->column_W = Vec3::UnitY();
  fields.Repair(
      "it does not state both its position and its orientation: the slices are in the order of " +
      std::string(slice->order) + ", and left and right are unknown");
}

void ParsePlace(const Fields& fields, const ImportLimits& limits, DicomSlice* slice) {
  const auto position = fields.NumbersOrNone(dicom::kPosition, 3);
  const auto orientation = fields.NumbersOrNone(dicom::kOrientation, 6);
  const bool has_directions = std::ranges::any_of(orientation, [](double x) { return x != 0.0; });
  if (position.empty() || !has_directions) return ParseOrder(fields, limits, slice);
  slice->position_W_mm = {position[0], position[1], position[2]};
  CheckPosition(*slice);
  slice->row_W = {orientation[0], orientation[1], orientation[2]};
  slice->column_W = {orientation[3], orientation[4], orientation[5]};
  const double longest =
      std::max(std::abs(slice->row_W.norm() - 1.0), std::abs(slice->column_W.norm() - 1.0));
  if (longest > kAboutUnit || std::abs(slice->row_W.dot(slice->column_W)) > kParallelSlices) {
    Refuse("it has an orientation that is not made of unit vectors; export it again");
  }
  if (longest > kParallelSlices) {
    fields.Repair("the vectors of its orientation are not quite unit vectors, and taken for them");
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
  if (content.has_frame_groups && fields.Text(dicom::kPosition).empty()) {
    Refuse(
        "it is an enhanced image, which states its places by frame and is not supported; save it "
        "as classic files, one per slice, or convert it with dcm2niix");
  }
  if (content.is_encoded_otherwise) {
    fields.Repair("it is encoded otherwise than its transfer syntax states; it is read as it is");
  }
  ParsePlace(fields, limits, &slice);
  slice.spacing_mm = limits.spacing_is_given ? std::array{1.0, 1.0} : ParseSpacing(fields);
  slice.size = {static_cast<std::int64_t>(fields.Number(dicom::kColumns, 0)),
                static_cast<std::int64_t>(fields.Number(dicom::kRows, 0))};
  slice.type = ParseType(fields);
  ParseBits(fields, content.stream, &slice);
  ParsePadding(fields, &slice);
  slice.intercept = fields.Number(dicom::kIntercept, 0.0);
  slice.slope = fields.Number(dicom::kSlope, 1.0);
  if (slice.slope == 0.0) {
    slice.slope = 1.0;  // as GDCM
    fields.Repair("its RescaleSlope is 0; 1 is taken");
  }
  slice.unit = ParseUnit(fields, content);
  slice.window_level = FirstNumber(fields.Text(dicom::kWindowLevel));
  slice.window_width = std::max(0.0, FirstNumber(fields.Text(dicom::kWindowWidth)));
  slice.is_ct = fields.Text(dicom::kModality) == "CT";
  slice.content = std::move(content);
  return slice;
}

}  // namespace palpate
