#include "server/rpc/volume_edit.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <string>

#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/limits.h"

namespace palpate {
namespace {

// 0, 0, 0 is a valid position, so a missing position must be an error.
Vec3 Required(bool has, const v1::Vector3& vector, const char* name) {
  if (!has) Refuse(std::string(name) + " is missing");
  return FromProto(vector);
}

DenseBlock BlockOf(const v1::DenseBlock& in) {
  static_assert(std::endian::native == std::endian::little, "as on the wire");
  const std::string& bytes = in.values();
  if (bytes.size() > kMostBlockBytes) {
    throw Error(ErrorKind::kTooLarge, "a block has at most 3 MiB of values: send it in parts");
  }
  if (bytes.size() % sizeof(float) != 0) {
    Refuse("the block's values are " + std::to_string(bytes.size()) +
           " bytes, which is not a multiple of 4 (float32)");
  }
  DenseBlock block;
  block.min = {in.min_x(), in.min_y(), in.min_z()};
  block.size = {in.size_x(), in.size_y(), in.size_z()};
  block.values.resize(bytes.size() / sizeof(float));
  if (!bytes.empty()) std::memcpy(block.values.data(), bytes.data(), bytes.size());
  return block;
}

SphereShape SphereOf(const v1::SphereShape& in) {
  return {Required(in.has_center(), in.center(), "sphere.center"), in.radius()};
}

BoxShape BoxOf(const v1::BoxShape& in) {
  return {Required(in.has_min(), in.min(), "box.min"), Required(in.has_max(), in.max(), "box.max")};
}

decltype(VolumeEdit::shape) ShapeOf(const v1::EditVolumeRequest& request) {
  switch (request.shape_case()) {
    case v1::EditVolumeRequest::kSphere:
      return SphereOf(request.sphere());
    case v1::EditVolumeRequest::kBox:
      return BoxOf(request.box());
    case v1::EditVolumeRequest::kCapsule: {
      const v1::CapsuleShape& in = request.capsule();
      return CapsuleShape{Required(in.has_from(), in.from(), "capsule.from"),
                          Required(in.has_to(), in.to(), "capsule.to"), in.radius()};
    }
    case v1::EditVolumeRequest::kBlock:
      return BlockOf(request.block());
    default:
      Refuse("the edit has no shape: give sphere, box, capsule or block");
  }
}

static_assert(EnumToProto<v1::EditFrame>(EditFrame::kIndex) == v1::EDIT_FRAME_INDEX);
static_assert(EnumToProto<v1::EditOperation>(EditOperation::kPaint) == v1::EDIT_OPERATION_PAINT);
static_assert(EnumToProto<v1::FilterKind>(FilterKind::kResample) == v1::FILTER_KIND_RESAMPLE);

EditFrame FrameOf(v1::EditFrame frame) {
  if (const auto known = EnumFromProto<EditFrame>(frame)) return *known;
  Refuse("the edit has no known frame: give EDIT_FRAME_WORLD or EDIT_FRAME_INDEX");
}

EditFrame FrameOf(const v1::EditVolumeRequest& request) {
  // A block always uses the index frame.
  if (request.frame() == v1::EDIT_FRAME_UNSPECIFIED && request.has_block()) {
    return EditFrame::kIndex;
  }
  return FrameOf(request.frame());
}

FilterKind KindOf(v1::FilterKind kind) {
  if (const auto known = EnumFromProto<FilterKind>(kind)) return *known;
  Refuse(
      "the filter has no known kind: give gaussian, mean, median, offset, mean-curvature or "
      "resample");
}

// Numbers above the range of int are refused later, as too large.
int Int(std::uint32_t number) {
  return static_cast<int>(std::min<std::uint32_t>(number, std::numeric_limits<int>::max()));
}

EditOperation OperationOf(v1::EditOperation operation) {
  if (const auto known = EnumFromProto<EditOperation>(operation)) return *known;
  Refuse("the edit has no known operation: give add, subtract, set, smooth or paint");
}

std::uint32_t Count(std::int64_t number) { return static_cast<std::uint32_t>(number); }

}  // namespace

VolumeEdit FromProto(const v1::EditVolumeRequest& request) {
  VolumeEdit edit;
  edit.shape = ShapeOf(request);
  edit.frame = FrameOf(request);
  edit.operation = OperationOf(request.operation());
  edit.value = request.value();
  if (request.has_strength()) edit.strength = request.strength();
  edit.falloff = request.falloff();
  return edit;
}

VolumeFilter FromProto(const v1::FilterVolumeRequest& request) {
  VolumeFilter filter;
  filter.kind = KindOf(request.kind());
  if (request.has_width()) filter.width = Int(request.width());
  if (request.has_iterations()) filter.iterations = Int(request.iterations());
  filter.distance_mm = request.distance_mm();
  filter.spacing_mm = FromProto(request.spacing_mm());
  if (request.has_sphere()) filter.region = SphereOf(request.sphere());
  if (request.has_box()) filter.region = BoxOf(request.box());
  if (request.region_case() != v1::FilterVolumeRequest::REGION_NOT_SET) {
    filter.frame = FrameOf(request.frame());
  }
  return filter;
}

v1::EditVolumeResponse ToProto(const EditOutcome& outcome, const AppliedTick& applied) {
  v1::EditVolumeResponse out;
  out.set_volume_revision(outcome.volume_revision);
  out.set_applied_tick(applied.tick);
  if (outcome.changed) {
    v1::IndexBox& box = *out.mutable_changed();
    box.set_min_x(Count(outcome.changed->min.x()));
    box.set_min_y(Count(outcome.changed->min.y()));
    box.set_min_z(Count(outcome.changed->min.z()));
    box.set_max_x(Count(outcome.changed->max.x()));
    box.set_max_y(Count(outcome.changed->max.y()));
    box.set_max_z(Count(outcome.changed->max.z()));
  }
  out.set_changed_voxels(outcome.changed_voxels);
  out.set_undo_steps(static_cast<std::uint32_t>(outcome.undo_steps));
  out.set_redo_steps(static_cast<std::uint32_t>(outcome.redo_steps));
  return out;
}

}  // namespace palpate
