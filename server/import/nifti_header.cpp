#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string_view>

#include "server/import/file_headers.h"
#include "server/import/image_header.h"

namespace palpate {
namespace {

// Reads the numbers of a NIfTI header, of both versions and both byte orders.
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
struct NiftiFields {
  bool big_endian = false;
  std::int64_t least_vox_offset = 0;  // the header and the four bytes after it
  int datatype = 0;
  int bitpix = 0;
  std::array<std::int64_t, 8> dim{};
  std::array<double, 8> pixdim{};
  double vox_offset = 0.0;
  double scl_slope = 0.0;
  double scl_inter = 0.0;
  int qform_code = 0;
  int sform_code = 0;
  std::array<double, 6> quaternion{};  // b, c, d and the offsets x, y, z
  std::array<double, 12> srow{};       // 3 rows of 4
  int xyzt_units = 0;
};

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

// Refuses data that are no NIfTI header, are too short, or name a second file.
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

ScalarType ParseType(int datatype) {
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

void ReadExtent(const NiftiFields& fields, ImageHeader* header) {
  if (fields.dim[0] < 1 || fields.dim[0] > 7) {
    Refuse("the NIfTI header has " + std::to_string(fields.dim[0]) + " axes; correct it");
  }
  std::vector<std::int64_t> axes(fields.dim.begin() + 1, fields.dim.begin() + 1 + fields.dim[0]);
  header->frames = TakeFrames(&axes);
  header->size = VolumeSize(axes);
}

constexpr char kHowElse[] = ", or choose another one with palpate-import --orientation";

template <typename Numbers>
void CheckFinite(const Numbers& numbers, const char* what, const char* how_else = "") {
  if (!std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); })) {
    Refuse(std::string("the NIfTI header's ") + what + " is not finite; correct it" + how_else);
  }
}

// None: it is no known unit.
std::optional<double> MillimetresPerUnit(const NiftiFields& fields) {
  constexpr int kSpace = 7;
  const int unit = fields.xyzt_units & kSpace;
  switch (unit) {
    case 1:
      return 1e3;
    case 3:
      return 1e-3;
    case 0:  // not stated
    case 2:
      return 1.0;
  }
  return std::nullopt;
}

const Mat3 kLpsFromRas = Vec3(-1.0, -1.0, 1.0).asDiagonal();

Vec3 PixdimSpacing(const NiftiFields& fields) {
  return {fields.pixdim[1], fields.pixdim[2], fields.pixdim[3]};
}

// As nibabel does: Analyze and SPM wrote a mirrored axis so.
void RepairPixdim(NiftiFields* fields, ImageHeader* header) {
  if (!(PixdimSpacing(*fields).minCoeff() < 0.0)) return;
  header->warnings.push_back(
      "pixdim states a negative spacing, " + ListOf(PixdimSpacing(*fields)) +
      "; its absolute value is taken, another one can be stated with --spacing-mm");
  for (std::size_t k = 1; k <= 3; ++k) fields->pixdim[k] = std::abs(fields->pixdim[k]);
}

ImageGeometry FromQform(const NiftiFields& fields) {
  const auto& q = fields.quaternion;
  Vec3 bcd(q[0], q[1], q[2]);
  // Rounding may make them a little too long.
  if (bcd.norm() > 1.0) bcd.normalize();
  const double a = std::sqrt(std::max(1.0 - bcd.squaredNorm(), 0.0));
  Mat3 rotation = Eigen::Quaterniond(a, bcd.x(), bcd.y(), bcd.z()).toRotationMatrix();
  if (fields.pixdim[0] < 0.0) rotation.col(2) *= -1.0;
  ImageGeometry geometry;
  geometry.spacing_mm = PixdimSpacing(fields);
  geometry.direction = kLpsFromRas * rotation;
  geometry.origin_W_mm = kLpsFromRas * Vec3(q[3], q[4], q[5]);
  return geometry;
}

ImageGeometry FromSform(const NiftiFields& fields) {
  const auto& s = fields.srow;
  ImageGeometry geometry;
  for (int col = 0; col < 3; ++col) {
    const Vec3 step(s[col], s[4 + col], s[8 + col]);
    geometry.spacing_mm[col] = step.norm();
    if (!(step.norm() > 0.0)) {
      Refuse(
          "the sform gives an axis no direction; correct it, or choose with palpate-import "
          "--orientation qform or none");
    }
    geometry.direction.col(col) = kLpsFromRas * step / step.norm();
  }
  geometry.origin_W_mm = kLpsFromRas * Vec3(s[3], s[7], s[11]);
  return geometry;
}

// Why the sform is no place; empty: it is one.
std::string WhyNoSform(const NiftiFields& fields) {
  const auto& s = fields.srow;
  for (std::size_t col = 0; col < 3; ++col) {
    if (Vec3(s[col], s[4 + col], s[8 + col]).isZero(0.0)) return "gives an axis no direction";
  }
  const bool is_finite = std::ranges::all_of(s, [](double x) { return std::isfinite(x); });
  return is_finite ? "" : "is not finite";
}

NiftiForm FormOf(const NiftiFields& fields, const std::optional<NiftiForm>& wanted,
                 ImageHeader* header) {
  const bool has_qform = fields.qform_code != 0;
  const bool has_sform = fields.sform_code != 0;
  if ((wanted == NiftiForm::kQform && !has_qform) || (wanted == NiftiForm::kSform && !has_sform)) {
    const std::string form = wanted == NiftiForm::kQform ? "qform" : "sform";
    Refuse("the file states no " + form + " (its " + form +
           "_code is 0); choose another --orientation");
  }
  if (wanted) return *wanted;
  const std::string why_no_sform = has_sform ? WhyNoSform(fields) : "";
  if (!why_no_sform.empty()) {
    header->warnings.push_back("the sform " + why_no_sform +
                               (has_qform ? "; the qform is taken"
                                          : "; only the spacing is taken, and sides are unknown"));
    return has_qform ? NiftiForm::kQform : NiftiForm::kNone;
  }
  return has_sform ? NiftiForm::kSform : has_qform ? NiftiForm::kQform : NiftiForm::kNone;
}

// In the file's unit of length.
ImageGeometry GeometryOf(const NiftiFields& fields, NiftiForm form) {
  if (form == NiftiForm::kSform) {
    CheckFinite(fields.srow, "sform", kHowElse);
    return FromSform(fields);
  }
  if (form == NiftiForm::kQform) {
    CheckFinite(fields.quaternion, "qform", kHowElse);
    return FromQform(fields);
  }
  ImageGeometry geometry;
  geometry.spacing_mm = PixdimSpacing(fields);
  return geometry;
}

void ToMillimetres(double mm, bool spacing_is_given, ImageGeometry* geometry) {
  geometry->spacing_mm *= mm;
  geometry->origin_W_mm *= mm;
  // Finite values may have overflowed, or become zero.
  for (double& spacing : geometry->spacing_mm) {
    if (spacing_is_given && !(spacing > 0.0 && std::isfinite(spacing))) spacing = 1.0;
    CheckSpacing(spacing);
  }
  CheckFinite(geometry->origin_W_mm, "place");
}

constexpr char kHowToChoose[] =
    "; palpate-import --orientation qform, sform or none chooses another one";

// What else the file says of the sform's voxels, which are used.
void WarnOfDifferences(const NiftiFields& fields, double mm, const ImageGeometry& sform,
                       bool spacing_is_given, ImageHeader* header) {
  if (fields.qform_code != 0) {
    ImageGeometry qform = FromQform(fields);
    qform.spacing_mm *= mm;
    qform.origin_W_mm *= mm;
    const PlaceError error = FarthestCorner(MapOf(qform), MapOf(sform), header->size);
    const bool is_mirrored = qform.direction.determinant() * sform.direction.determinant() < 0.0;
    if (std::isfinite(error.mm) && error.voxels > kFarOff) {
      header->warnings.push_back(
          "qform and sform disagree: they place a corner of the volume " + Short(error.mm) +
          " mm apart" +
          (is_mirrored ? ", and one is the other's mirror image (left and right)" : "") +
          "; the sform is taken" + kHowToChoose);
    }
  }
  constexpr double kSameSpacing = 0.01;
  const Vec3 pixdim_mm = mm * PixdimSpacing(fields);
  const Vec3 off_mm = (sform.spacing_mm - pixdim_mm).cwiseAbs();
  if (!spacing_is_given && (off_mm.array() > kSameSpacing * pixdim_mm.array()).any()) {
    header->warnings.push_back("the voxel spacing of the sform, " + ListOf(sform.spacing_mm) +
                               " mm, is not that of pixdim, " + ListOf(pixdim_mm) +
                               " mm: it differs by up to " + Short(off_mm.maxCoeff()) +
                               " mm; the sform's is taken" + kHowToChoose);
  }
}

void StraightenSform(const NiftiFields& fields, bool is_wanted, ImageHeader* header) {
  const PlaceError error = Straighten(header->size, &header->geometry);
  const std::string sheared =
      "the sform is sheared: its axes are not at right angles; right angles put a corner of the "
      "volume " +
      Short(error.mm) + " mm elsewhere";
  if (!is_wanted && !(error.voxels <= kFarOff)) {
    Refuse(sheared + "; resample the volume, or choose with palpate-import --orientation: " +
           (fields.qform_code != 0 ? "qform, " : "") + "sform (the nearest right angles) or none");
  }
  if (error.voxels > kSlightlyOff) {
    header->warnings.push_back(sheared + "; the nearest right angles are taken");
  }
}

void ReadGeometry(NiftiFields fields, const std::optional<NiftiForm>& wanted, bool spacing_is_given,
                  ImageHeader* header) {
  const std::optional<double> mm = MillimetresPerUnit(fields);
  const NiftiForm form = FormOf(fields, wanted, header);
  if (form != NiftiForm::kSform && !spacing_is_given) RepairPixdim(&fields, header);
  header->geometry = GeometryOf(fields, form);
  ToMillimetres(mm.value_or(1.0), spacing_is_given, &header->geometry);
  header->geometry.is_lps = form != NiftiForm::kNone;
  if (!mm) header->geometry.unknown_unit = "xyzt_units " + std::to_string(fields.xyzt_units);
  if (form == NiftiForm::kSform) {
    if (!wanted) {
      WarnOfDifferences(fields, mm.value_or(1.0), header->geometry, spacing_is_given, header);
    }
    StraightenSform(fields, wanted.has_value(), header);
  }
  if (form == NiftiForm::kNone && !wanted) {
    header->warnings.push_back(
        "the file states no orientation (qform_code and sform_code are 0): left and right are "
        "unknown");
  }
}

// As nibabel and nifti_clib: what is not finite is no scale.
void ReadScale(const NiftiFields& fields, ImageHeader* header) {
  if (!std::isfinite(fields.scl_slope)) {
    header->warnings.push_back(
        "scl_slope is not a finite number; the values are taken as they are stored");
    return;
  }
  // A slope of zero means: no scale, and no intercept either.
  if (fields.scl_slope == 0.0) return;
  header->slope = fields.scl_slope;
  if (std::isfinite(fields.scl_inter)) {
    header->intercept = fields.scl_inter;
  } else {
    header->warnings.push_back("scl_inter is not a finite number; 0 is taken");
  }
}

}  // namespace

ImageHeader ParseNiftiHeader(std::string_view head, const std::optional<NiftiForm>& form,
                             bool spacing_is_given) {
  const NiftiFields fields = ReadNiftiFields(head);
  ImageHeader header;
  header.big_endian = fields.big_endian;
  header.type = ParseType(fields.datatype);
  if (fields.bitpix != 8 * ByteCount(header.type)) {
    header.warnings.push_back("the NIfTI header's bitpix, " + std::to_string(fields.bitpix) +
                              ", is not that of its datatype, " + Name(header.type) +
                              ", which is taken");
  }
  ReadExtent(fields, &header);
  ReadGeometry(fields, form, spacing_is_given, &header);
  ReadScale(fields, &header);
  const double offset = fields.vox_offset;
  if (!(offset >= static_cast<double>(fields.least_vox_offset)) || offset > 1e9 ||
      offset != std::floor(offset)) {
    Refuse("the NIfTI header's vox_offset is not a place behind the header; correct it");
  }
  header.skip_bytes = static_cast<std::int64_t>(offset);
  header.may_be_longer = true;
  return header;
}

}  // namespace palpate
