#include <gdcmImageReader.h>
#include <gdcmTrace.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "server/import/dicom_folder.h"
#include "server/import/dicom_slice.h"
#include "server/import/dicom_stack.h"
#include "server/import/readers.h"
#include "server/import/value_checks.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {
namespace {

// The values of a DICOM slice, through GDCM. GDCM sees a file of ours with nothing but the pixels
// and their description: other elements, odd types of elements and padding do not reach it.
//
// Threads: one. Reads files. Errors: palpate::Error.
struct DicomPixels {
  // With rescale or table, x fastest. Padding is not a number.
  std::vector<float> values;
  float least_padding = std::numeric_limits<float>::infinity();
  // Pixels have something in more bits than BitsStored says. These are left out, unless all bits
  // are taken: of a compressed slice, or if signs show that numbers have them.
  bool has_more_bits = false;
  bool takes_all_bits = false;
  // Pixels have their sign in the highest of the bits that are stored, and none above.
  bool has_short_signs = false;
  // Negative pixels have the bits above set, too, and no other has a sign in those that are stored.
  bool has_long_signs = false;
};

// Writes elements of explicit type.
class ElementWriter {
 public:
  explicit ElementWriter(bool big_endian) : big_endian_(big_endian) {}

  void Number(std::uint32_t value, int bytes) {
    for (int k = 0; k < bytes; ++k) {
      const int shift = 8 * (big_endian_ ? bytes - 1 - k : k);
      text_ += static_cast<char>(value >> shift & 0xff);
    }
  }
  void Head(std::uint32_t tag, const char* type) {
    Number(tag >> 16, 2);
    Number(tag & 0xffff, 2);
    text_ += type;
  }
  void Text(std::uint32_t tag, const char* type, std::string value) {
    if (value.size() % 2 != 0) value += type == std::string("UI") ? '\0' : ' ';
    Head(tag, type);
    Number(static_cast<std::uint32_t>(value.size()), 2);
    text_ += value;
  }
  void Short(std::uint32_t tag, std::uint32_t value) {
    Head(tag, "US");
    Number(2, 2);
    Number(value, 2);
  }
  void Raw(const std::string& bytes) { text_ += bytes; }
  const std::string& text() const { return text_; }

 private:
  bool big_endian_;
  std::string text_;
};

constexpr char kCt[] = "1.2.840.10008.5.1.4.1.1.2";

std::string FileHead(const DicomFile& file, bool is_big_endian) {
  const std::string plain = is_big_endian ? "1.2.840.10008.1.2.2" : "1.2.840.10008.1.2.1";
  ElementWriter meta(false);
  meta.Text(0x00020002, "UI", kCt);
  meta.Text(0x00020003, "UI", "1.2.3");
  meta.Text(0x00020010, "UI", file.has_fragments ? file.syntax : plain);
  ElementWriter head(false);
  head.Raw(std::string(128, '\0') + "DICM");
  head.Head(0x00020000, "UL");
  head.Number(4, 2);
  head.Number(static_cast<std::uint32_t>(meta.text().size()), 4);
  head.Raw(meta.text());
  return head.text();
}

// GDCM swaps only bytes of two. Numbers of 8 bits lie in words of two bytes, too, if they are no
// bytes (OB).
void ToLittleEndian(std::uint32_t number_bytes, std::string* pixels) {
  const std::size_t word = number_bytes == 1 ? 2 : number_bytes;
  for (std::size_t at = 0; at + word <= pixels->size(); at += word) {
    std::reverse(pixels->begin() + static_cast<std::ptrdiff_t>(at),
                 pixels->begin() + static_cast<std::ptrdiff_t>(at + word));
  }
}

// Pixels that are not compressed, or by RLE, are described to GDCM as unsigned numbers of all bits,
// which it gives back as they are.
std::string PixelsOnly(const DicomSlice& slice) {
  const DicomFile& file = slice.content;
  const auto number = [&](const DicomTag& tag, std::uint32_t absent) {
    const std::string text = file.Text(tag);
    return text.empty() ? absent : static_cast<std::uint32_t>(ParseInteger(text, tag.name));
  };
  const std::uint32_t bits = number(dicom::kBits, 16);
  const bool is_packed = bits == 12;
  const bool as_stated = file.stream.bits > 0 || is_packed;
  const std::uint32_t stored = as_stated ? number(dicom::kBitsStored, bits) : bits;
  const bool is_big_endian = file.big_endian && is_packed;
  ElementWriter out(is_big_endian);
  out.Text(0x00080016, "UI", kCt);
  out.Text(0x00080018, "UI", "1.2.3");
  out.Short(dicom::kSamples.number, 1);
  out.Text(dicom::kPhotometric.number, "CS", "MONOCHROME2");
  out.Short(dicom::kRows.number, static_cast<std::uint32_t>(slice.size[1]));
  out.Short(dicom::kColumns.number, static_cast<std::uint32_t>(slice.size[0]));
  out.Short(dicom::kBits.number, bits);
  out.Short(dicom::kBitsStored.number, stored);
  out.Short(dicom::kHighBit.number, as_stated ? number(dicom::kHighBit, stored - 1) : stored - 1);
  out.Short(dicom::kSign.number, as_stated ? number(dicom::kSign, 0) : 0);
  std::string pixels(static_cast<std::size_t>(file.pixels_end - file.pixels_begin), '\0');
  std::ifstream in(slice.file, std::ios::binary);
  in.seekg(file.pixels_begin);
  if (!in.read(pixels.data(), std::ssize(pixels))) Refuse("the file changed while it was read");
  if (file.big_endian && !is_packed && !(file.has_bytes && bits == 8)) {
    ToLittleEndian(bits / 8, &pixels);
  }
  out.Head(0x7fe00010, file.has_fragments ? "OB" : "OW");
  out.Number(0, 2);
  out.Number(file.has_fragments ? 0xffffffff : static_cast<std::uint32_t>(pixels.size()), 4);
  out.Raw(pixels);
  return FileHead(file, is_big_endian) + out.text();
}

// The number in a pixel's bits, least first.
std::int64_t NumberIn(std::uint64_t pattern, int bits, bool is_signed) {
  const std::uint64_t mask = ~std::uint64_t{0} >> (64 - bits);
  const bool is_negative = is_signed && (pattern >> (bits - 1) & 1) != 0;
  return static_cast<std::int64_t>(is_negative ? pattern | ~mask : pattern & mask);
}

// Pixels of `width` bits each.
class Pixels {
 public:
  Pixels(const std::string& bytes, int width, const DicomSlice& slice)
      : bytes_(bytes), width_(width), slice_(slice), low_(std::min(slice.low_bit, width - 1)) {
    const int of_stream = slice.content.stream.bits;
    whole_ = of_stream > 0 ? std::min(of_stream, width) : width;
    bits_ = std::clamp(slice.bits, 1, width - low_);
  }

  DicomPixels Values() {
    DicomPixels pixels;
    for (std::size_t n = 0; n < Count(); ++n) {
      const std::uint64_t pattern = PatternAt(n);
      pixels.has_more_bits |= !Fits(pattern);
      pixels.has_short_signs |= IsEmptyAbove(pattern) && Stored(pattern) < 0;
      pixels.has_long_signs |= !IsEmptyAbove(pattern) && Whole(pattern) < 0 && Fits(pattern);
    }
    // What is not compressed may have an overlay in them. Long signs are beside no short ones.
    const bool is_wide = pixels.has_short_signs && pixels.has_long_signs && low_ + bits_ < whole_;
    pixels.takes_all_bits = is_wide || (pixels.has_more_bits && slice_.content.stream.bits > 0);
    if (pixels.takes_all_bits) {
      bits_ = whole_;
      pixels.has_short_signs = false;
    }
    for (std::size_t n = 0; n < Count(); ++n) {
      const std::uint64_t pattern = PatternAt(n);
      const bool is_whole = IsPadding(Whole(pattern));
      pixels.values.push_back(ValueOf(is_whole ? Whole(pattern) : Stored(pattern)));
      is_padding_.push_back(is_whole || IsPadding(Stored(pattern)));
    }
    TakePadding(&pixels);
    return pixels;
  }

 private:
  // Among the other values there may be the same number: then it must lie in a corner, too.
  void TakePadding(DicomPixels* pixels) const {
    const auto width = static_cast<std::size_t>(slice_.size[0]);
    const bool is_at_corner = is_padding_.front() || is_padding_[width - 1] ||
                              is_padding_[Count() - width] || is_padding_.back();
    float least = std::numeric_limits<float>::infinity(), greatest = -least;
    for (std::size_t n = 0; n < Count(); ++n) {
      if (is_padding_[n]) continue;
      least = std::min(least, pixels->values[n]);
      greatest = std::max(greatest, pixels->values[n]);
    }
    for (std::size_t n = 0; n < Count(); ++n) {
      float& value = pixels->values[n];
      if (!is_padding_[n] || (!is_at_corner && value >= least && value <= greatest)) continue;
      pixels->least_padding = std::min(pixels->least_padding, value);
      value = std::numeric_limits<float>::quiet_NaN();
    }
  }
  std::size_t Count() const { return 8 * bytes_.size() / static_cast<std::size_t>(width_); }
  std::uint64_t PatternAt(std::size_t n) const {
    const auto bytes = static_cast<std::size_t>(width_ / 8);
    std::uint64_t pattern = 0;
    std::memcpy(&pattern, bytes_.data() + n * bytes, bytes);
    return pattern;
  }
  std::int64_t Stored(std::uint64_t pattern) const {
    return NumberIn(pattern >> low_, bits_, slice_.is_signed);
  }
  std::int64_t Whole(std::uint64_t pattern) const {
    return NumberIn(pattern, whole_, slice_.is_signed);
  }
  // Padding may be a number that BitsStored has no room for.
  bool IsPadding(std::int64_t number) const {
    return slice_.least_padding <= number && number <= slice_.greatest_padding;
  }
  bool IsEmptyAbove(std::uint64_t pattern) const {
    return low_ + bits_ < width_ && pattern >> (low_ + bits_) == 0;
  }
  // The bits above those that are stored are 0, or continue the sign.
  bool Fits(std::uint64_t pattern) const {
    return IsEmptyAbove(pattern) || Whole(pattern) >> low_ == Stored(pattern) ||
           IsPadding(Whole(pattern));
  }
  float ValueOf(std::int64_t stored) const {
    if (const DicomTable* const table = slice_.content.table.get()) {
      const std::int64_t last = std::ssize(table->entries) - 1;
      return table->entries[static_cast<std::size_t>(
          std::clamp<std::int64_t>(stored - table->first, 0, last))];
    }
    return static_cast<float>(slice_.intercept + slice_.slope * static_cast<double>(stored));
  }

  const std::string& bytes_;
  const int width_;
  const DicomSlice& slice_;
  const int low_;
  std::vector<bool> is_padding_;
  int bits_, whole_;  // bits that are stored; that a pixel has
};

DicomPixels ReadDicomPixels(const DicomSlice& slice) {
  std::istringstream in(PixelsOnly(slice));
  gdcm::ImageReader reader;
  reader.SetStream(in);
  DicomPixels pixels;
  if (reader.Read()) {
    const gdcm::Image& image = reader.GetImage();
    std::string bytes(image.GetBufferLength(), '\0');
    if (image.GetBuffer(bytes.data())) {
      const auto width = 8 * std::ssize(bytes) / (slice.size[0] * slice.size[1]);
      if ((width == 8 || width == 16 || width == 32) &&
          8 * std::ssize(bytes) == width * slice.size[0] * slice.size[1]) {
        pixels = Pixels(bytes, static_cast<int>(width), slice).Values();
      }
    }
  }
  if (std::ssize(pixels.values) != slice.size[0] * slice.size[1]) {
    Refuse("the pixels of the slice " + FileName(slice.file) + " (transfer syntax " +
           Quoted(slice.content.syntax) +
           ") cannot be decoded; export the series uncompressed, as Explicit VR Little Endian");
  }
  return pixels;
}

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
