#include "server/import/nifti_fields.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "server/import/nifti_header.h"

namespace palpate {
namespace {

constexpr std::string_view kMagic1("n+1\0", 4);
constexpr std::string_view kMagic1Pair("ni1\0", 4);
constexpr std::string_view kMagic2("n+2\0\r\n\032\n", 8);
constexpr std::string_view kMagic2Pair("ni2\0\r\n\032\n", 8);

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

  template <typename Number, typename Array>
  void GetAll(std::size_t offset, Array* out) const {
    for (auto& element : *out) {
      element = Get<Number>(offset);
      offset += sizeof(Number);
    }
  }

 private:
  std::string_view head_;
  bool swap_;
};

// Byte offsets as in nifti1.h.
void ReadVersion1(const Reader& reader, NiftiFields* fields) {
  fields->least_vox_offset = 352;
  reader.GetAll<std::int16_t>(40, &fields->dim);
  fields->datatype = reader.Get<std::int16_t>(70);
  fields->bitpix = reader.Get<std::int16_t>(72);
  reader.GetAll<float>(76, &fields->pixdim);
  fields->vox_offset = reader.Get<float>(108);
  fields->scl_slope = reader.Get<float>(112);
  fields->scl_inter = reader.Get<float>(116);
  fields->xyzt_units = reader.Get<std::uint8_t>(123);
  fields->qform_code = reader.Get<std::int16_t>(252);
  fields->sform_code = reader.Get<std::int16_t>(254);
  reader.GetAll<float>(256, &fields->quaternion);
  reader.GetAll<float>(280, &fields->srow);
}

// Byte offsets as in nifti2.h.
void ReadVersion2(const Reader& reader, NiftiFields* fields) {
  fields->least_vox_offset = 544;
  fields->datatype = reader.Get<std::int16_t>(12);
  fields->bitpix = reader.Get<std::int16_t>(14);
  reader.GetAll<std::int64_t>(16, &fields->dim);
  reader.GetAll<double>(104, &fields->pixdim);
  fields->vox_offset = static_cast<double>(reader.Get<std::int64_t>(168));
  fields->scl_slope = reader.Get<double>(176);
  fields->scl_inter = reader.Get<double>(184);
  fields->qform_code = reader.Get<std::int32_t>(344);
  fields->sform_code = reader.Get<std::int32_t>(348);
  reader.GetAll<double>(352, &fields->quaternion);
  reader.GetAll<double>(400, &fields->srow);
  fields->xyzt_units = reader.Get<std::int32_t>(500);
}

void CheckMagic(std::string_view found, std::string_view wanted, std::string_view pair,
                const char* format) {
  if (found == pair) {
    Refuse("the voxels are in a second file (.hdr and .img); convert them to one .nii file");
  }
  if (found != wanted) {
    Refuse(std::string("this is no ") + format + " file: it lacks the letters " +
           std::string(wanted.substr(0, 3)) + "; it is damaged, or of another format");
  }
}

void CheckLength(std::string_view head, std::size_t needed) {
  if (head.size() < needed) {
    Refuse("the file is shorter than a NIfTI header; it is damaged or incomplete");
  }
}

}  // namespace

NiftiFields ReadNiftiFields(std::string_view head) {
  CheckLength(head, sizeof(std::int32_t));
  for (const bool swap : {false, true}) {
    const Reader reader(head, swap);
    NiftiFields fields;
    fields.big_endian = swap != (std::endian::native == std::endian::big);
    const auto length = static_cast<std::size_t>(reader.Get<std::uint32_t>(0));
    if (length == kNifti1HeaderBytes) {
      CheckLength(head, length);
      CheckMagic(head.substr(344, 4), kMagic1, kMagic1Pair, "NIfTI-1");
      ReadVersion1(reader, &fields);
      return fields;
    }
    if (length == kNifti2HeaderBytes) {
      CheckLength(head, length);
      CheckMagic(head.substr(4, 8), kMagic2, kMagic2Pair, "NIfTI-2");
      ReadVersion2(reader, &fields);
      return fields;
    }
  }
  Refuse("this is no NIfTI file: its first number is neither 348 nor 540");
}

}  // namespace palpate
