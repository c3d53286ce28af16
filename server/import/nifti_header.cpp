#include "server/import/nifti_header.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace palpate {
namespace {

// Byte offsets in the header, from nifti1.h.
constexpr std::size_t kDim = 40;
constexpr std::size_t kDatatype = 70;
constexpr std::size_t kBitpix = 72;
constexpr std::size_t kPixdim = 76;
constexpr std::size_t kVoxOffset = 108;
constexpr std::size_t kSclSlope = 112;
constexpr std::size_t kSclInter = 116;
constexpr std::size_t kQformCode = 252;
constexpr std::size_t kSformCode = 254;
constexpr std::size_t kQuaternB = 256;  // b, c, d, x, y, z offsets
constexpr std::size_t kSrowX = 280;     // 3 x 4 numbers
constexpr std::size_t kMagic = 344;

constexpr std::int32_t kNifti2HeaderBytes = 540;

class Reader {
 public:
  Reader(std::string_view head, bool swap) : head_(head), swap_(swap) {}

  template <typename Number>
  Number Get(std::size_t offset) const {
    char bytes[sizeof(Number)];
    std::memcpy(bytes, head_.data() + offset, sizeof(Number));
    if (swap_) std::reverse(bytes, bytes + sizeof(Number));
    Number number;
    std::memcpy(&number, bytes, sizeof(Number));
    return number;
  }

 private:
  std::string_view head_;
  bool swap_;
};

bool IsSwapped(std::string_view head) {
  for (const bool swap : {false, true}) {
    const auto length = Reader(head, swap).Get<std::int32_t>(0);
    if (length == static_cast<std::int32_t>(kNiftiHeaderBytes)) return swap;
    if (length == kNifti2HeaderBytes) {
      Refuse("this is a NIfTI-2 file, which is not supported; convert it to NIfTI-1");
    }
  }
  Refuse("this is no NIfTI-1 file: its first number is not 348");
}

ScalarType ParseType(std::int16_t datatype) {
  switch (datatype) {
    case 2:
      return ScalarType::kUint8;
    case 4:
      return ScalarType::kInt16;
    case 8:
      return ScalarType::kInt32;
    case 16:
      return ScalarType::kFloat32;
    case 64:
      return ScalarType::kFloat64;
    case 256:
      return ScalarType::kInt8;
    case 512:
      return ScalarType::kUint16;
    case 768:
      return ScalarType::kUint32;
    case 32:
    case 128:
    case 1792:
    case 2304:
      Refuse("every voxel has several values (complex or colour); extract one of them first");
  }
  Refuse("voxels of NIfTI datatype " + std::to_string(datatype) +
         " are not supported; convert them to 8, 16 or 32 bit integers, float or double");
}

std::array<std::int64_t, 3> ParseSize(const Reader& reader) {
  const auto dimension = reader.Get<std::int16_t>(kDim);
  if (dimension < 1 || dimension > 7) {
    Refuse("the NIfTI header has " + std::to_string(dimension) + " axes; correct it");
  }
  std::vector<std::int64_t> axes;
  for (int k = 1; k <= dimension; ++k) axes.push_back(reader.Get<std::int16_t>(kDim + 2 * k));
  return VolumeSize(axes);
}

void CheckFinite(const Reader& reader, std::size_t offset, int count, const char* what) {
  for (int k = 0; k < count; ++k) {
    if (!std::isfinite(reader.Get<float>(offset + 4 * k))) {
      Refuse(std::string("the NIfTI header's ") + what + " is not finite; correct it");
    }
  }
}

void CheckGeometry(const Reader& reader) {
  for (int k = 1; k <= 3; ++k) CheckSpacing(reader.Get<float>(kPixdim + 4 * k));
  if (reader.Get<std::int16_t>(kQformCode) > 0) CheckFinite(reader, kQuaternB, 6, "qform");
  if (reader.Get<std::int16_t>(kSformCode) > 0) CheckFinite(reader, kSrowX, 12, "sform");
  CheckFinite(reader, kSclSlope, 1, "scl_slope");
  CheckFinite(reader, kSclInter, 1, "scl_inter");
}

}  // namespace

ImageHeader ParseNiftiHeader(std::string_view head) {
  if (head.size() < kNiftiHeaderBytes) {
    Refuse("the file is shorter than a NIfTI-1 header; it is damaged or incomplete");
  }
  const Reader reader(head, IsSwapped(head));
  const std::string_view magic = head.substr(kMagic, 4);
  if (magic == std::string_view("ni1\0", 4)) {
    Refuse("the voxels are in a second file (.hdr and .img); convert them to one .nii file");
  }
  if (magic != std::string_view("n+1\0", 4)) {
    Refuse("this is no NIfTI-1 file: it lacks the letters n+1");
  }

  ImageHeader header;
  header.type = ParseType(reader.Get<std::int16_t>(kDatatype));
  if (reader.Get<std::int16_t>(kBitpix) != 8 * ByteCount(header.type)) {
    Refuse("the NIfTI header's datatype and bitpix disagree; correct it");
  }
  header.size = ParseSize(reader);
  CheckGeometry(reader);
  const auto offset = reader.Get<float>(kVoxOffset);
  // 352: the header and the four bytes that announce extensions.
  if (!(offset >= 352.0f) || offset > 1e9f || offset != std::floor(offset)) {
    Refuse("the NIfTI header's vox_offset is not a place behind the header; correct it");
  }
  header.skip_bytes = static_cast<std::int64_t>(offset);
  header.may_be_longer = true;
  return header;
}

}  // namespace palpate
