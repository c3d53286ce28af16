#include "server/import/dicom_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <iterator>
#include <string>
#include <string_view>
#include <utility>

#include "server/import/image_header.h"

namespace palpate {
namespace {

constexpr std::string_view kRoot = "1.2.840.10008.1.2";

// Behind kRoot: implicit and explicit, big endian; JPEG, JPEG-LS, JPEG 2000; RLE.
constexpr std::string_view kRead[] = {"",      ".1",    ".2",    ".4.50", ".4.51", ".4.53", ".4.55",
                                      ".4.57", ".4.70", ".4.80", ".4.81", ".4.90", ".4.91", ".5"};

constexpr std::pair<std::string_view, std::string_view> kNames[] = {
    {".1.98", "encapsulated uncompressed"},
    {".1.99", "deflated"},
    {".4.92", "JPEG 2000 part 2"},
    {".4.93", "JPEG 2000 part 2"},
    {".4.94", "JPIP"},
    {".4.95", "JPIP"},
    {".4.100", "MPEG-2"},
    {".4.101", "MPEG-2"},
    {".4.102", "MPEG-4"},
    {".4.103", "MPEG-4"},
    {".4.104", "MPEG-4"},
    {".4.105", "MPEG-4"},
    {".4.106", "MPEG-4"},
    {".4.107", "HEVC"},
    {".4.108", "HEVC"},
    {".4.110", "JPEG XL"},
    {".4.111", "JPEG XL"},
    {".4.112", "JPEG XL"},
    {".4.201", "HTJ2K, high-throughput JPEG 2000"},
    {".4.202", "HTJ2K, high-throughput JPEG 2000"},
    {".4.203", "HTJ2K, high-throughput JPEG 2000"},
    {".4.204", "JPIP HTJ2K"},
    {".4.205", "JPIP HTJ2K"},
};

// DICOM's transfer syntaxes: how a file and its pixels are encoded.
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
//
// Refuses a transfer syntax that we or GDCM cannot read, by its name. Empty: not stated.
void CheckDicomSyntax(const std::string& uid) {
  if (uid.empty()) return;
  std::string name;
  if (uid.starts_with(kRoot)) {
    const std::string_view rest = std::string_view(uid).substr(kRoot.size());
    if (std::ranges::find(kRead, rest) != std::end(kRead)) return;
    const auto* const known =
        std::ranges::find_if(kNames, [&](const auto& one) { return one.first == rest; });
    if (known != std::end(kNames)) name = std::string(known->second) + ", ";
  }
  Refuse("its encoding (transfer syntax " + name + Quoted(uid) +
         ") is not supported; export the series uncompressed, as Explicit VR Little Endian");
}

constexpr std::uint32_t kUndefined = 0xffffffff;
constexpr int kDeepest = 16;
constexpr std::int64_t kLongestText = 1024;

constexpr std::uint32_t Tag(std::uint32_t group, std::uint32_t element) {
  return group << 16 | element;
}
constexpr std::uint32_t kTransferSyntax = Tag(0x0002, 0x0010);
constexpr std::uint32_t kTable = Tag(0x0028, 0x3000);
constexpr std::uint32_t kTableDescriptor = Tag(0x0028, 0x3002);
constexpr std::uint32_t kTableType = Tag(0x0028, 0x3004);
constexpr std::uint32_t kTableEntries = Tag(0x0028, 0x3006);
constexpr std::uint32_t kSharedGroups = Tag(0x5200, 0x9229);
constexpr std::uint32_t kFrameGroups = Tag(0x5200, 0x9230);
constexpr std::uint32_t kFloatPixels = Tag(0x7fe0, 0x0008);
constexpr std::uint32_t kDoublePixels = Tag(0x7fe0, 0x0009);
constexpr std::uint32_t kPixels = Tag(0x7fe0, 0x0010);
constexpr std::uint32_t kItem = Tag(0xfffe, 0xe000);
constexpr std::uint32_t kItemEnd = Tag(0xfffe, 0xe00d);
constexpr std::uint32_t kSequenceEnd = Tag(0xfffe, 0xe0dd);

// Whatever type these have in the file: numbers of two or four bytes, of eight, and text.
constexpr DicomTag kNumbers[] = {
    dicom::kSamples, dicom::kRows,    dicom::kColumns,      dicom::kBits,      dicom::kBitsStored,
    dicom::kHighBit, dicom::kPadding, dicom::kPaddingLimit, dicom::kTimeIndex, dicom::kSign};
constexpr DicomTag kReals[] = {dicom::kBValue, dicom::kTriggerDelay, dicom::kCardiacPhase};
constexpr DicomTag kTexts[] = {
    dicom::kImageType,    dicom::kInstance,        dicom::kAcquisitionDateTime,
    dicom::kModality,     dicom::kDescription,     dicom::kAcquisitionTime,
    dicom::kStudy,        dicom::kSeries,          dicom::kPosition,
    dicom::kOrientation,  dicom::kSeriesNumber,    dicom::kFrameOfReference,
    dicom::kPhotometric,  dicom::kFrames,          dicom::kPixelSpacing,
    dicom::kWindowLevel,  dicom::kWindowWidth,     dicom::kIntercept,
    dicom::kSlope,        dicom::kRescaleType,     dicom::kKvp,
    dicom::kEchoTime,     dicom::kInversionTime,   dicom::kEcho,
    dicom::kSlicePitch,   dicom::kTriggerTime,     dicom::kKernel,
    dicom::kFlipAngle,    dicom::kAcquisition,     dicom::kInstanceNumber,
    dicom::kTimePosition, dicom::kSliceLocation,   dicom::kThickness,
    dicom::kContentTime,  dicom::kAcquisitionDate, dicom::kComponent,
    dicom::kContrast,     dicom::kSequence,        dicom::kRepetitionTime,
    dicom::kFilter};

template <std::size_t count>
bool Holds(const DicomTag (&tags)[count], std::uint32_t number) {
  return std::ranges::find(tags, number, &DicomTag::number) != std::end(tags);
}

struct Encoding {
  bool explicit_vr = true;
  bool big_endian = false;
};

struct Element {
  std::uint32_t tag = 0;
  std::string vr;  // empty: implicit
  std::uint32_t length = 0;
};

// The fields that determine the number of pixel bytes.
struct PixelShape {
  std::int64_t rows = 0;
  std::int64_t columns = 0;
  std::int64_t samples = 1;
  std::int64_t frames = 1;
  std::int64_t bits = 0;
};

bool IsCapital(char c) { return c >= 'A' && c <= 'Z'; }

// The head of a compressed stream: JPEG 2000's SIZ, or the frame header of JPEG and JPEG-LS.
DicomStream DescribeStream(std::string_view head, std::string_view syntax) {
  const auto byte = [head](std::size_t at) {
    return at < head.size() ? static_cast<unsigned char>(head[at]) : 0;
  };
  constexpr std::string_view kSiz("\xff\x4f\xff\x51");
  constexpr std::size_t kDepthInSiz = 42;
  constexpr std::string_view kJpeg2000("1.2.840.10008.1.2.4.9");
  const std::size_t at_siz = syntax.starts_with(kJpeg2000) ? head.find(kSiz) : head.npos;
  if (at_siz != head.npos) {
    const int depth = byte(at_siz + kDepthInSiz);
    return {.bits = (depth & 0x7f) + 1, .is_jpeg_2000 = true, .is_signed = (depth & 0x80) != 0};
  }
  for (std::size_t at = 2; head.starts_with("\xff\xd8") && byte(at) == 0xff;) {
    const int marker = byte(at + 1);
    const bool is_table = marker == 0xc4 || marker == 0xc8 || marker == 0xcc;
    if (marker == 0xf7 || (marker >= 0xc0 && marker <= 0xcf && !is_table)) {
      return {.bits = byte(at + 4)};
    }
    at += marker == 0xff ? 1u : 2u + static_cast<unsigned>(byte(at + 2) << 8 | byte(at + 3));
  }
  return {};
}

class Walker {
 public:
  Walker(std::istream* in, std::int64_t length) : in_(in), length_(length) {}

  DicomFile Walk() {
    file_.is_dicom = FindStart();
    if (!file_.is_dicom) return file_;
    const Encoding encoding = WalkMeta();
    file_.big_endian = encoding.big_endian;
    while (at_ < length_) {
      const Element element = ReadElement(encoding);
      if (element.tag == kPixels) {
        file_.has_bytes = element.vr == "OB";
        file_.pixels_begin = at_;
        CheckPixels(element);
        file_.has_pixels = true;
        file_.pixels_end = at_;
        return file_;
      }
      if (element.tag == kFloatPixels || element.tag == kDoublePixels) {
        Refuse("its pixels are floating point numbers, which is not supported; export integers");
      }
      // Zeros after the last element are padding.
      if (element.tag == 0) break;
      Note(element, encoding);
      SkipValue(element, encoding, 0);
    }
    if (shape_.rows > 0) RefuseCut();
    return file_;
  }

 private:
  [[noreturn]] static void RefuseCut() {
    Refuse("the DICOM file is truncated or damaged; copy or export it again");
  }

  std::string Read(std::int64_t count) {
    if (count > length_ - at_) RefuseCut();
    std::string bytes(static_cast<std::size_t>(count), '\0');
    in_->seekg(at_);
    if (!in_->read(bytes.data(), count)) RefuseCut();
    at_ += count;
    return bytes;
  }

  std::uint32_t ReadNumber(int count, bool big_endian) {
    const std::string bytes = Read(count);
    std::uint32_t number = 0;
    for (int k = 0; k < count; ++k) {
      const int from = big_endian ? k : count - 1 - k;
      number = number << 8 | static_cast<unsigned char>(bytes[static_cast<std::size_t>(from)]);
    }
    return number;
  }

  void Skip(std::int64_t count) {
    if (count > length_ - at_) RefuseCut();
    at_ += count;
  }

  Element ReadElement(const Encoding& encoding) {
    const bool big = encoding.big_endian;
    Element element;
    element.tag = ReadNumber(2, big) << 16;
    element.tag |= ReadNumber(2, big);
    const bool delimiter = element.tag >> 16 == 0xfffe;
    if (!encoding.explicit_vr || delimiter || element.tag == 0) {
      element.length = ReadNumber(4, big);
      return element;
    }
    element.vr = Read(2);
    if (!IsCapital(element.vr[0]) || !IsCapital(element.vr[1])) {
      // As pydicom: an element of implicit type among others.
      element.vr.clear();
      at_ -= 2;
      element.length = ReadNumber(4, big);
      file_.is_encoded_otherwise = true;
      return element;
    }
    static constexpr std::array<std::string_view, 13> kLong = {
        "OB", "OD", "OF", "OL", "OV", "OW", "SQ", "SV", "UC", "UN", "UR", "UT", "UV"};
    for (const std::string_view vr : kLong) {
      if (element.vr != vr) continue;
      Skip(2);
      element.length = ReadNumber(4, big);
      return element;
    }
    element.length = ReadNumber(2, big);
    return element;
  }

  // As GDCM: a file without a preamble begins with the file meta information, or with the first
  // elements of the image.
  bool FindStart() {
    if (length_ < 132) return false;
    at_ = 128;
    if (Read(4) == "DICM") return true;
    at_ = 0;
    const std::uint32_t group = ReadNumber(2, false), number = ReadNumber(2, false);
    at_ = 0;
    return (group == 2 && number <= 0x10) || (group == 8 && number <= 0x18);
  }

  // Every element begins with its tag, and the groups of the first elements are below 256. An
  // explicit type is two capitals, which as part of a length would be far more than the first
  // elements have.
  Encoding EncodingOfNext(const Encoding& stated) {
    const std::int64_t start = at_;
    if (length_ - at_ < 6) return stated;
    const std::string head = Read(6);
    at_ = start;
    return {IsCapital(head[4]) && IsCapital(head[5]), head[0] == 0 && head[1] != 0};
  }

  // Reads the file meta information, which says how the rest is encoded.
  Encoding WalkMeta() {
    std::string& syntax = file_.syntax;
    while (at_ < length_) {
      const std::int64_t start = at_;
      if (ReadNumber(2, false) != 0x0002) {
        at_ = start;
        break;
      }
      at_ = start;
      const Encoding encoding{EncodingOfNext({}).explicit_vr, false};
      const Element element = ReadElement(encoding);
      if (element.tag == kTransferSyntax) {
        if (element.length > kLongestText) RefuseCut();
        syntax = Read(element.length);
        while (!syntax.empty() && (syntax.back() == '\0' || syntax.back() == ' '))
          syntax.pop_back();
      } else {
        SkipValue(element, encoding, 0);
      }
    }
    CheckDicomSyntax(syntax);
    const Encoding stated{syntax != "1.2.840.10008.1.2", syntax == "1.2.840.10008.1.2.2"};
    const Encoding seen = EncodingOfNext(stated);
    file_.is_encoded_otherwise |= !syntax.empty() && (seen.explicit_vr != stated.explicit_vr ||
                                                      seen.big_endian != stated.big_endian);
    return seen;
  }

  void SkipValue(const Element& element, const Encoding& encoding, int depth) {
    if (element.length != kUndefined) return Skip(element.length);
    // An element of unknown type (UN) has implicit content.
    const Encoding inner = element.vr == "UN" ? Encoding{false, false} : encoding;
    if (depth > kDeepest) RefuseCut();
    for (;;) {
      const Element item = ReadElement(inner);
      if (item.tag == kSequenceEnd) return;
      if (item.tag != kItem) RefuseCut();
      if (item.length != kUndefined) {
        Skip(item.length);
        continue;
      }
      for (Element nested = ReadElement(inner); nested.tag != kItemEnd;
           nested = ReadElement(inner)) {
        SkipValue(nested, inner, depth + 1);
      }
    }
  }

  // Reads the value and returns to its start.
  void Note(const Element& element, const Encoding& encoding) {
    const std::int64_t start = at_;
    const bool is_number = element.length == 2 || element.length == 4;
    if (element.tag == kSharedGroups || element.tag == kFrameGroups) file_.has_frame_groups = true;
    if (Holds(kNumbers, element.tag) && is_number) {
      const std::uint32_t number =
          ReadNumber(static_cast<int>(element.length), encoding.big_endian);
      file_.values[element.tag] = std::to_string(number);
      if (element.tag == dicom::kRows.number) shape_.rows = number;
      if (element.tag == dicom::kColumns.number) shape_.columns = number;
      if (element.tag == dicom::kSamples.number) shape_.samples = number;
      if (element.tag == dicom::kBits.number) shape_.bits = number;
    } else if (Holds(kTexts, element.tag) && element.length <= kLongestText) {
      const std::string text = Read(element.length);
      const std::string_view value = Trim(std::string_view(text.c_str()));
      file_.values[element.tag] = value;
      if (element.tag == dicom::kFrames.number && !value.empty()) {
        const double frames = ParseReal(Trim(value), dicom::kFrames.name);
        shape_.frames = frames >= 2.0 && frames < 1e9 ? static_cast<std::int64_t>(frames) : 1;
      }
    } else if (Holds(kReals, element.tag) && element.length == sizeof(double)) {
      const std::uint32_t first = ReadNumber(4, encoding.big_endian);
      const std::uint32_t second = ReadNumber(4, encoding.big_endian);
      const std::uint64_t high = encoding.big_endian ? first : second;
      const std::uint64_t low = encoding.big_endian ? second : first;
      file_.values[element.tag] = std::to_string(std::bit_cast<double>(high << 32 | low));
    } else if (element.tag == kTable) {
      ReadTable(element, encoding);
    }
    at_ = start;
  }

  // The only item of a Modality LUT Sequence.
  void ReadTable(const Element& sequence, const Encoding& encoding) {
    const Encoding inner = sequence.vr == "UN" ? Encoding{false, false} : encoding;
    if (sequence.length == 0) return;
    const Element item = ReadElement(inner);
    if (item.tag != kItem) return;
    const std::int64_t end = item.length == kUndefined ? length_ : at_ + item.length;
    DicomTable table;
    std::array<std::uint32_t, 3> shape{};  // count, first, bits
    std::string bytes;
    while (at_ < end) {
      const Element element = ReadElement(inner);
      if (element.tag == kItemEnd) break;
      const std::int64_t start = at_;
      if (element.tag == kTableDescriptor && element.length == 6) {
        for (std::uint32_t& number : shape) number = ReadNumber(2, inner.big_endian);
      } else if (element.tag == kTableType && element.length <= kLongestText) {
        table.type = Trim(Read(element.length).c_str());
      } else if (element.tag == kTableEntries && element.length <= 2u << 16) {
        bytes = Read(element.length);
      }
      at_ = start;
      SkipValue(element, inner, 1);
    }
    const bool is_signed = file_.Text(dicom::kSign) == "1";
    table.first = is_signed ? static_cast<std::int16_t>(shape[1]) : std::int64_t{shape[1]};
    TakeEntries(bytes, shape[0] == 0 ? 1u << 16 : shape[0], inner.big_endian, &table);
    file_.table = std::make_shared<const DicomTable>(std::move(table));
  }

  // Entries of 8 bits may have a byte each.
  static void TakeEntries(const std::string& bytes, std::size_t count, bool big_endian,
                          DicomTable* table) {
    const std::size_t width = bytes.size() >= 2 * count ? 2 : 1;
    if (bytes.size() < width * count) {
      Refuse("its table of values (Modality LUT) is not complete; export it again");
    }
    for (std::size_t k = 0; k < count; ++k) {
      const auto byte = [&](std::size_t n) {
        return static_cast<unsigned char>(bytes[width * k + n]);
      };
      const unsigned low = byte(width == 2 && big_endian ? 1 : 0);
      const unsigned high = width == 1 ? 0u : byte(big_endian ? 0 : 1);
      table->entries.push_back(static_cast<std::uint16_t>(high << 8 | low));
    }
  }

  void CheckPixels(const Element& element) {
    const PixelShape& s = shape_;
    if (s.rows < 1 || s.columns < 1 || s.samples < 1 || s.frames < 1 || s.bits < 1 || s.bits > 64) {
      Refuse("the DICOM file does not state the size of its image; export it again");
    }
    file_.has_fragments = element.length == kUndefined;
    if (file_.has_fragments) return SkipFragments();
    const std::int64_t pixels = s.rows * s.columns * s.samples;  // below 2^48
    std::int64_t bits = 0;
    if (__builtin_mul_overflow(pixels, s.frames, &bits) ||
        __builtin_mul_overflow(bits, s.bits, &bits) || bits / 8 > element.length) {
      Refuse("the DICOM file has fewer pixels than it states; copy or export it again");
    }
    Skip(element.length);
  }

  // Compressed pixels: a table of offsets and items until a delimiter.
  void SkipFragments() {
    constexpr std::int64_t kLongestHead = 1 << 16;
    for (int n = 0; at_ < length_; ++n) {
      const Element item = ReadElement(Encoding{});
      if (item.tag == kSequenceEnd) return;
      if (item.tag != kItem || item.length == kUndefined) RefuseCut();
      const std::int64_t start = at_;
      if (n == 1)
        file_.stream =
            DescribeStream(Read(std::min<std::int64_t>(item.length, kLongestHead)), file_.syntax);
      at_ = start;
      Skip(item.length);
    }
    RefuseCut();
  }

  std::istream* in_;
  std::int64_t length_;
  std::int64_t at_ = 0;
  PixelShape shape_;
  DicomFile file_;
};

}  // namespace

DicomFile CheckDicomFile(std::istream* in, std::int64_t length) {
  return Walker(in, length).Walk();
}

}  // namespace palpate
