// Any bytes as a file of a format that palpate-import reads: format u8, file. Readers of ours and
// libtiff read it to its end; GDCM gets to see only the pixels.
#include <cmath>
#include <filesystem>
#include <numeric>
#include <sstream>
#include <string>
#include <string_view>

#include "server/import/data_check.h"
#include "server/import/dicom_file.h"
#include "server/import/dicom_slice.h"
#include "server/import/file_headers.h"
#include "server/import/tiff_stack.h"
#include "server/import/voxel_reader.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/fuzz/scratch_file.h"

namespace palpate::fuzz {
namespace {

// The most voxels that a header may ask for: more than any file of the corpus has, and few enough
// for thousands of inputs a second.
constexpr std::int64_t kMostVoxels = 4096;
constexpr std::int64_t kMostFrames = 3;

// Reads every byte that a reader delivers.
class VoxelCount {
 public:
  VoxelSink Sink() {
    return [this](LeafType type, const void* voxels, std::size_t count) {
      const auto* const bytes = static_cast<const std::uint8_t*>(voxels);
      sum_ = std::accumulate(bytes, bytes + count * VoxelBytes(type), sum_);
      count_ += static_cast<std::int64_t>(count);
    };
  }
  void ExpectAllOf(const ImageHeader& header) const {
    FUZZ_CHECK(count_ == header.size[0] * header.size[1] * header.size[2]);
  }

 private:
  std::int64_t count_ = 0;
  volatile std::uint64_t sum_ = 0;
};

void ReadFrame(const ScratchFile& file, const ImageHeader& header, std::int64_t frame) {
  VoxelCount count;
  ReadVoxels(file.path(), header, frame, count.Sink());
  count.ExpectAllOf(header);
}

ImportLimits SmallLimits() { return {.max_voxels = kMostVoxels}; }

void CheckHeader(const ImageHeader& header) {
  for (const std::int64_t axis : header.size) FUZZ_CHECK(axis >= 2);
  FUZZ_CHECK(header.frames >= 1);
  FUZZ_CHECK(header.begin >= 0);
  FUZZ_CHECK(header.skip_bytes >= ImageHeader::kVoxelsAtEnd);
  FUZZ_CHECK(std::isfinite(header.slope) && std::isfinite(header.intercept));
  const ImageGeometry& geometry = header.geometry;
  FUZZ_CHECK(geometry.spacing_mm.allFinite() && geometry.spacing_mm.minCoeff() > 0.0);
  FUZZ_CHECK(geometry.origin_W_mm.allFinite() && geometry.direction.allFinite());
  const std::filesystem::path data(header.data_file);
  FUZZ_CHECK(data.is_relative());
  for (const auto& part : data) FUZZ_CHECK(part != "..");
}

// Reads the file as the importer does: the header, the presence of the voxels, and the voxels of
// all frames. A header that `parse` refuses never reaches a file.
template <typename Parse>
void ReadPlain(std::span<const std::uint8_t> bytes, const ScratchFile& file, ImageFormat format,
               Parse parse) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (!text.starts_with("\x1f\x8b")) CheckHeader(parse(text));
  file.Write(bytes);
  const ImageHeader header = ReadCheckedHeader(file.path(), format, SmallLimits());
  CheckHeader(header);
  FUZZ_CHECK(header.size[0] * header.size[1] * header.size[2] <= kMostVoxels);
  for (std::int64_t frame = 0; frame < std::min(header.frames, kMostFrames); ++frame) {
    CheckFrame(frame, header.frames);
    ReadFrame(file, header, frame);
  }
}

// Voxels without a header, as somebody described them: size 3 x i64, offset i64, type u8 (one
// beyond them is no type), big endian u8, voxels.
void ReadRaw(Input input, const ScratchFile& file) {
  RawVoxels raw;
  for (std::int64_t& axis : raw.size) axis = input.Take<std::int64_t>();
  raw.offset_bytes = input.Take<std::int64_t>();
  const int type = input.Take<std::uint8_t>() % 9;
  raw.type = type < 8 ? Name(static_cast<ScalarType>(type)) : "float16";
  raw.big_endian = input.Take<std::uint8_t>() % 2 != 0;
  file.Write(input.TakeRest());
  const ImageHeader header = CheckedRawHeader(file.path(), raw, SmallLimits());
  CheckHeader(header);
  ReadFrame(file, header, 0);
}

void ReadTiff(std::span<const std::uint8_t> bytes) {
  static const ScratchFile file("stack.tif");
  file.Write(bytes);
  const TiffStack stack = OpenTiffStack(file.path(), SmallLimits());
  FUZZ_CHECK(stack.files.size() == 1);
  FUZZ_CHECK(stack.has_one_page ||
             stack.pages.size() == static_cast<std::size_t>(stack.header.size[2]));
  FUZZ_CHECK(std::isfinite(stack.header.slope) && std::isfinite(stack.header.intercept));
  VoxelCount count;
  ReadTiffVoxels(
      stack, [](double) {}, count.Sink());
  count.ExpectAllOf(stack.header);
}

void ReadDicom(std::span<const std::uint8_t> bytes) {
  std::istringstream in(std::string(bytes.begin(), bytes.end()));
  const DicomFile file = CheckDicomFile(&in, static_cast<std::int64_t>(bytes.size()));
  FUZZ_CHECK(file.is_dicom || !file.has_pixels);
  FUZZ_CHECK(!file.is_dicom || bytes.size() > 131);
  FUZZ_CHECK(!file.table || !file.table->entries.empty());
  if (!file.has_pixels) return;
  FUZZ_CHECK(0 < file.pixels_begin && file.pixels_begin <= file.pixels_end &&
             file.pixels_end <= static_cast<std::int64_t>(bytes.size()));
  FileNotes repairs;
  const DicomSlice slice = ParseSlice("slice.dcm", file, {}, &repairs);
  FUZZ_CHECK(slice.position_W_mm.allFinite() && std::abs(slice.row_W.norm() - 1.0) < 1e-9);
  FUZZ_CHECK(slice.spacing_mm[0] > 0.0 && slice.spacing_mm[1] > 0.0);
  FUZZ_CHECK(std::isfinite(slice.slope) && std::isfinite(slice.intercept));
  FUZZ_CHECK(slice.low_bit >= 0);
}

void ReadImage(Input input) {
  static const ScratchFile file("image");
  const auto format = input.Take<std::uint8_t>();
  const auto bytes = input.TakeRest();
  switch (format % 6) {
    case 0:
      return ReadPlain(bytes, file, ImageFormat::kNrrd,
                       [](std::string_view head) { return ParseNrrdHeader(head, true); });
    case 1:
      return ReadPlain(bytes, file, ImageFormat::kMetaImage,
                       [](std::string_view head) { return ParseMetaImageHeader(head); });
    case 2:
      return ReadPlain(bytes, file, ImageFormat::kNifti,
                       [](std::string_view text) { return ParseNiftiHeader(text); });
    case 3:
      return ReadTiff(bytes);
    case 4:
      return ReadDicom(bytes);
    case 5:
      return ReadRaw(Input(bytes), file);
  }
}

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(image_fuzz) {
  try {
    palpate::fuzz::ReadImage(palpate::fuzz::Input({data, size}));
  } catch (const palpate::Error&) {
    // An Error is expected. Any other exception ends the program.
  }
  return 0;
}
