#include "server/import/nifti_header.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "server/import/image_geometry.h"
#include "server/import/nifti_fields.h"

namespace palpate {
namespace {

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
