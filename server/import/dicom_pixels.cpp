#include "server/import/dicom_pixels.h"

#include <gdcmImageReader.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>

namespace palpate {
namespace {

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

std::string FileHead(const DicomFile& file) {
  const std::string plain = file.big_endian ? "1.2.840.10008.1.2.2" : "1.2.840.10008.1.2.1";
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

std::string PixelsOnly(const DicomSlice& slice) {
  const DicomFile& file = slice.content;
  const auto number = [&](const DicomTag& tag, std::uint32_t absent) {
    const std::string text = file.Text(tag);
    return text.empty() ? absent : static_cast<std::uint32_t>(ParseInteger(text, tag.name));
  };
  const std::uint32_t bits = number(dicom::kBits, 16);
  const std::uint32_t stored = number(dicom::kBitsStored, bits);
  ElementWriter out(file.big_endian);
  out.Text(0x00080016, "UI", kCt);
  out.Text(0x00080018, "UI", "1.2.3");
  out.Short(dicom::kSamples.number, 1);
  out.Text(dicom::kPhotometric.number, "CS", "MONOCHROME2");
  out.Short(dicom::kRows.number, static_cast<std::uint32_t>(slice.size[1]));
  out.Short(dicom::kColumns.number, static_cast<std::uint32_t>(slice.size[0]));
  out.Short(dicom::kBits.number, bits);
  out.Short(dicom::kBitsStored.number, stored);
  out.Short(dicom::kHighBit.number, number(dicom::kHighBit, stored - 1));
  out.Short(dicom::kSign.number, number(dicom::kSign, 0));
  std::string pixels(static_cast<std::size_t>(file.pixels_end - file.pixels_begin), '\0');
  std::ifstream in(slice.file, std::ios::binary);
  in.seekg(file.pixels_begin);
  if (!in.read(pixels.data(), std::ssize(pixels))) Refuse("the file changed while it was read");
  out.Head(0x7fe00010, file.has_fragments ? "OB" : "OW");
  out.Number(0, 2);
  out.Number(file.has_fragments ? 0xffffffff : static_cast<std::uint32_t>(pixels.size()), 4);
  out.Raw(pixels);
  return FileHead(file) + out.text();
}

template <class Stored>
std::vector<float> Values(const std::string& bytes, const DicomSlice& slice) {
  std::vector<float> values(bytes.size() / sizeof(Stored));
  const DicomTable* const table = slice.content.table.get();
  for (std::size_t k = 0; k < values.size(); ++k) {
    Stored stored;
    std::memcpy(&stored, bytes.data() + k * sizeof(Stored), sizeof(Stored));
    if (table) {
      const std::int64_t last = std::ssize(table->entries) - 1;
      const std::int64_t entry =
          std::clamp<std::int64_t>(std::int64_t{stored} - table->first, 0, last);
      values[k] = table->entries[static_cast<std::size_t>(entry)];
    } else {
      values[k] = static_cast<float>(slice.intercept + slice.slope * static_cast<double>(stored));
    }
  }
  return values;
}

std::vector<float> ValuesOf(gdcm::PixelFormat::ScalarType type, const std::string& bytes,
                            const DicomSlice& slice) {
  switch (type) {
    case gdcm::PixelFormat::UINT8:
      return Values<std::uint8_t>(bytes, slice);
    case gdcm::PixelFormat::INT8:
      return Values<std::int8_t>(bytes, slice);
    case gdcm::PixelFormat::UINT12:
    case gdcm::PixelFormat::UINT16:
      return Values<std::uint16_t>(bytes, slice);
    case gdcm::PixelFormat::INT12:
    case gdcm::PixelFormat::INT16:
      return Values<std::int16_t>(bytes, slice);
    case gdcm::PixelFormat::UINT32:
      return Values<std::uint32_t>(bytes, slice);
    case gdcm::PixelFormat::INT32:
      return Values<std::int32_t>(bytes, slice);
    default:
      return {};
  }
}

}  // namespace

std::vector<float> ReadDicomPixels(const DicomSlice& slice) {
  std::istringstream in(PixelsOnly(slice));
  gdcm::ImageReader reader;
  reader.SetStream(in);
  std::vector<float> values;
  if (reader.Read()) {
    const gdcm::Image& image = reader.GetImage();
    std::string bytes(image.GetBufferLength(), '\0');
    if (image.GetBuffer(bytes.data())) {
      values = ValuesOf(image.GetPixelFormat().GetScalarType(), bytes, slice);
    }
  }
  if (std::ssize(values) != slice.size[0] * slice.size[1]) {
    Refuse("the pixels of the slice " + FileName(slice.file) + " (transfer syntax " +
           Quoted(slice.content.syntax) +
           ") cannot be decoded; export the series uncompressed, as Explicit VR Little Endian");
  }
  return values;
}

}  // namespace palpate
