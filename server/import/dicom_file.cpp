#include "server/import/dicom_file.h"

#include <array>
#include <string>
#include <string_view>

#include "server/import/image_header.h"

namespace palpate {
namespace {

constexpr std::uint32_t kUndefined = 0xffffffff;
constexpr int kDeepest = 16;
constexpr std::int64_t kLongestText = 128;

constexpr std::uint32_t Tag(std::uint32_t group, std::uint32_t element) {
  return group << 16 | element;
}
constexpr std::uint32_t kTransferSyntax = Tag(0x0002, 0x0010);
constexpr std::uint32_t kSamples = Tag(0x0028, 0x0002);
constexpr std::uint32_t kFrames = Tag(0x0028, 0x0008);
constexpr std::uint32_t kRows = Tag(0x0028, 0x0010);
constexpr std::uint32_t kColumns = Tag(0x0028, 0x0011);
constexpr std::uint32_t kBits = Tag(0x0028, 0x0100);
constexpr std::uint32_t kPixels = Tag(0x7fe0, 0x0010);
constexpr std::uint32_t kItem = Tag(0xfffe, 0xe000);
constexpr std::uint32_t kItemEnd = Tag(0xfffe, 0xe00d);
constexpr std::uint32_t kSequenceEnd = Tag(0xfffe, 0xe0dd);

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

class Walker {
 public:
  Walker(std::istream* in, std::int64_t length) : in_(in), length_(length) {}

  DicomFile Walk() {
    if (length_ < 132) return {};
    at_ = 128;
    if (Read(4) != "DICM") return {};
    const Encoding encoding = WalkMeta();
    while (at_ < length_) {
      const Element element = ReadElement(encoding);
      if (element.tag == kPixels) {
        CheckPixels(element);
        return {true, true, at_};
      }
      // Zeros after the last element are padding.
      if (element.tag == 0) break;
      Note(element, encoding);
      SkipValue(element, encoding, 0);
    }
    if (shape_.rows > 0) RefuseCut();
    return {true, false, 0};
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
    for (const char c : element.vr) {
      if (c < 'A' || c > 'Z') RefuseCut();
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

  // Reads the file meta information, which says how the rest is encoded.
  Encoding WalkMeta() {
    std::string syntax;
    while (at_ < length_) {
      const std::int64_t start = at_;
      if (ReadNumber(2, false) != 0x0002) {
        at_ = start;
        break;
      }
      at_ = start;
      const Element element = ReadElement(Encoding{});
      if (element.tag == kTransferSyntax) {
        if (element.length > kLongestText) RefuseCut();
        syntax = Read(element.length);
        while (!syntax.empty() && (syntax.back() == '\0' || syntax.back() == ' '))
          syntax.pop_back();
      } else {
        SkipValue(element, Encoding{}, 0);
      }
    }
    if (syntax == "1.2.840.10008.1.2.1.99") {
      Refuse("a deflated DICOM file is not supported; export it uncompressed");
    }
    return {syntax != "1.2.840.10008.1.2", syntax == "1.2.840.10008.1.2.2"};
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
    std::int64_t* const field = element.tag == kRows      ? &shape_.rows
                                : element.tag == kColumns ? &shape_.columns
                                : element.tag == kSamples ? &shape_.samples
                                : element.tag == kBits    ? &shape_.bits
                                                          : nullptr;
    const std::int64_t start = at_;
    if (field) {
      if (element.length != 2) RefuseCut();
      *field = ReadNumber(2, encoding.big_endian);
    } else if (element.tag == kFrames) {
      if (element.length > kLongestText) RefuseCut();
      const std::string text = Read(element.length);
      const std::string_view digits = Trim(std::string_view(text.c_str()));
      shape_.frames = digits.empty() ? 1 : ParseInteger(digits, "NumberOfFrames");
    }
    at_ = start;
  }

  void CheckPixels(const Element& element) {
    const PixelShape& s = shape_;
    if (s.rows < 1 || s.columns < 1 || s.samples < 1 || s.frames < 1 || s.bits < 1 || s.bits > 64) {
      Refuse("the DICOM file does not state the size of its image; export it again");
    }
    if (element.length == kUndefined) return SkipFragments();
    const std::int64_t pixels = s.rows * s.columns * s.samples;  // below 2^48
    std::int64_t bits = 0;
    if (__builtin_mul_overflow(pixels, s.frames, &bits) ||
        __builtin_mul_overflow(bits, s.bits, &bits) || bits / 8 > element.length) {
      Refuse("the DICOM file has fewer pixels than it states; copy or export it again");
    }
    Skip(element.length);
  }

  // Compressed pixels: items until a delimiter.
  void SkipFragments() {
    while (at_ < length_) {
      const Element item = ReadElement(Encoding{});
      if (item.tag == kSequenceEnd) return;
      if (item.tag != kItem || item.length == kUndefined) RefuseCut();
      Skip(item.length);
    }
    RefuseCut();
  }

  std::istream* in_;
  std::int64_t length_;
  std::int64_t at_ = 0;
  PixelShape shape_;
};

}  // namespace

DicomFile CheckDicomFile(std::istream* in, std::int64_t length) {
  return Walker(in, length).Walk();
}

}  // namespace palpate
