#include "server/import/nifti_header.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "server/import/nifti_fields.h"

namespace palpate {
namespace {

// Above this cosine between two of its axes, an sform counts as sheared.
constexpr double kSheared = 1e-3;

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

template <typename Numbers>
void CheckFinite(const Numbers& numbers, const char* what) {
  if (!std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); })) {
    Refuse(std::string("the NIfTI header's ") + what + " is not finite; correct it");
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

ImageGeometry FromQform(const NiftiFields& fields) {
  const auto& q = fields.quaternion;
  Vec3 bcd(q[0], q[1], q[2]);
  // Rounding may make them a little too long.
  if (bcd.norm() > 1.0) bcd.normalize();
  const double a = std::sqrt(std::max(1.0 - bcd.squaredNorm(), 0.0));
  Mat3 rotation = Eigen::Quaterniond(a, bcd.x(), bcd.y(), bcd.z()).toRotationMatrix();
  if (fields.pixdim[0] < 0.0) rotation.col(2) *= -1.0;
  ImageGeometry geometry;
  geometry.spacing_mm = {fields.pixdim[1], fields.pixdim[2], fields.pixdim[3]};
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
    CheckSpacing(geometry.spacing_mm[col]);
    geometry.direction.col(col) = kLpsFromRas * step / step.norm();
  }
  geometry.origin_W_mm = kLpsFromRas * Vec3(s[3], s[7], s[11]);
  return geometry;
}

bool IsSheared(const ImageGeometry& geometry) {
  const Mat3 gram = geometry.direction.transpose() * geometry.direction;
  return !gram.isApprox(Mat3::Identity(), kSheared);
}

ImageGeometry ParseGeometry(const NiftiFields& fields) {
  constexpr int kScanner = 1;
  for (int k = 1; k <= 3; ++k) CheckSpacing(fields.pixdim[k]);
  const bool has_qform = fields.qform_code > 0;
  const bool has_sform = fields.sform_code > 0;
  ImageGeometry geometry;
  geometry.spacing_mm = {fields.pixdim[1], fields.pixdim[2], fields.pixdim[3]};
  if (has_qform) {
    CheckFinite(fields.quaternion, "qform");
    geometry = FromQform(fields);
  }
  if (has_sform) CheckFinite(fields.srow, "sform");
  if (has_sform && (!has_qform || fields.sform_code == kScanner)) {
    const ImageGeometry sform = FromSform(fields);
    if (!has_qform || !IsSheared(sform)) geometry = sform;
  }
  const std::optional<double> mm = MillimetresPerUnit(fields);
  if (!mm) geometry.unknown_unit = "xyzt_units " + std::to_string(fields.xyzt_units);
  geometry.spacing_mm *= mm.value_or(1.0);
  geometry.origin_W_mm *= mm.value_or(1.0);
  // Finite values may have overflowed, or become zero.
  for (const double spacing : geometry.spacing_mm) CheckSpacing(spacing);
  CheckFinite(geometry.origin_W_mm, "place");
  return geometry;
}

void ReadScale(const NiftiFields& fields, ImageHeader* header) {
  CheckFinite(std::array{fields.scl_slope}, "scl_slope");
  CheckFinite(std::array{fields.scl_inter}, "scl_inter");
  // A slope of zero means: no scale, and no intercept either.
  if (fields.scl_slope == 0.0) return;
  header->slope = fields.scl_slope;
  header->intercept = fields.scl_inter;
}

}  // namespace

ImageHeader ParseNiftiHeader(std::string_view head) {
  const NiftiFields fields = ReadNiftiFields(head);
  ImageHeader header;
  header.big_endian = fields.big_endian;
  header.type = ParseType(fields.datatype);
  if (fields.bitpix != 8 * ByteCount(header.type)) {
    Refuse("the NIfTI header's datatype and bitpix disagree; correct it");
  }
  ReadExtent(fields, &header);
  header.geometry = ParseGeometry(fields);
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
