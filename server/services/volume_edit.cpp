#include "server/services/volume_edit.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <string>

#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/limits.h"
#include "common/wire/values.h"

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

// Errors: kInvalidArgument; `what` says what to give.
template <class Enum>
Enum Known(int number, const char* what) {
  const Enum known = EnumeratorOf<Enum>(number);
  if (known == Enum::kUnknown)
    Refuse(fmt::format("{}: give {}", what, fmt::join(kWords<Enum>, " or ")));
  return known;
}

EditFrame FrameOf(const v1::EditVolumeRequest& request) {
  // A block always uses the index frame.
  if (request.frame() == v1::EDIT_FRAME_UNSPECIFIED && request.has_block()) {
    return EditFrame::kIndex;
  }
  return Known<EditFrame>(request.frame(), "the edit has no known frame");
}

// Numbers above the range of int are refused later, as too large.
int Int(std::uint32_t number) {
  return static_cast<int>(std::min<std::uint32_t>(number, std::numeric_limits<int>::max()));
}

}  // namespace

VolumeEdit FromProto(const v1::EditVolumeRequest& request) {
  VolumeEdit edit;
  edit.shape = ShapeOf(request);
  edit.frame = FrameOf(request);
  edit.operation = Known<EditOperation>(request.operation(), "the edit has no known operation");
  edit.value = request.value();
  if (request.has_strength()) edit.strength = request.strength();
  edit.falloff = request.falloff();
  return edit;
}

VolumeFilter FromProto(const v1::FilterVolumeRequest& request) {
  VolumeFilter filter;
  filter.kind = Known<FilterKind>(request.kind(), "the filter has no known kind");
  if (request.has_width()) filter.width = Int(request.width());
  if (request.has_iterations()) filter.iterations = Int(request.iterations());
  filter.distance_mm = request.distance_mm();
  filter.spacing_mm = FromProto(request.spacing_mm());
  if (request.has_sphere()) filter.region = SphereOf(request.sphere());
  if (request.has_box()) filter.region = BoxOf(request.box());
  if (request.region_case() != v1::FilterVolumeRequest::REGION_NOT_SET) {
    filter.frame = Known<EditFrame>(request.frame(), "the filter has no known frame");
  }
  return filter;
}

v1::EditVolumeResponse ToProto(const EditOutcome& outcome, const AppliedTick& applied) {
  return palpate::ToProto(
      EditVolumeResponse{.volume_revision = outcome.volume_revision,
                         .applied_tick = applied.tick,
                         .changed = outcome.changed,
                         .changed_voxels = outcome.changed_voxels,
                         .undo_steps = static_cast<std::uint32_t>(outcome.undo_steps),
                         .redo_steps = static_cast<std::uint32_t>(outcome.redo_steps)});
}

}  // namespace palpate
