#include "server/rpc/volume_edit.h"

#include <bit>
#include <cstring>
#include <string>

#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/limits.h"

namespace palpate {
namespace {

[[noreturn]] void Refuse(const std::string& message) {
  throw Error(ErrorKind::kInvalidArgument, message);
}

// 0, 0, 0 is a place too: one that is missing is a mistake.
Vec3 Required(bool has, const v1::Vector3& vector, const char* name) {
  if (!has) Refuse(std::string(name) + " is missing");
  return FromProto(vector);
}

DenseBlock FromProto(const v1::DenseBlock& in) {
  static_assert(std::endian::native == std::endian::little, "as on the wire");
  const std::string& bytes = in.values();
  if (bytes.size() > kMostBlockBytes) {
    throw Error(ErrorKind::kTooLarge, "a block has at most 3 MiB of values: send it in parts");
  }
  if (bytes.size() % sizeof(float) != 0) {
    Refuse("the block's values are " + std::to_string(bytes.size()) +
           " bytes, which are no whole float32 numbers");
  }
  DenseBlock block;
  block.min = {in.min_x(), in.min_y(), in.min_z()};
  block.size = {in.size_x(), in.size_y(), in.size_z()};
  block.values.resize(bytes.size() / sizeof(float));
  if (!bytes.empty()) std::memcpy(block.values.data(), bytes.data(), bytes.size());
  return block;
}

decltype(VolumeEdit::shape) ShapeOf(const v1::EditVolumeRequest& request) {
  switch (request.shape_case()) {
    case v1::EditVolumeRequest::kSphere: {
      const v1::SphereShape& in = request.sphere();
      return SphereShape{Required(in.has_center(), in.center(), "sphere.center"), in.radius()};
    }
    case v1::EditVolumeRequest::kBox: {
      const v1::BoxShape& in = request.box();
      return BoxShape{Required(in.has_min(), in.min(), "box.min"),
                      Required(in.has_max(), in.max(), "box.max")};
    }
    case v1::EditVolumeRequest::kCapsule: {
      const v1::CapsuleShape& in = request.capsule();
      return CapsuleShape{Required(in.has_from(), in.from(), "capsule.from"),
                          Required(in.has_to(), in.to(), "capsule.to"), in.radius()};
    }
    case v1::EditVolumeRequest::kBlock:
      return FromProto(request.block());
    default:
      Refuse("the edit has no shape: give sphere, box, capsule or block");
  }
}

EditFrame FrameOf(const v1::EditVolumeRequest& request) {
  switch (request.frame()) {
    case v1::EDIT_FRAME_WORLD:
      return EditFrame::kWorld;
    case v1::EDIT_FRAME_INDEX:
      return EditFrame::kIndex;
    default:
      // A block has one frame only.
      if (request.frame() == v1::EDIT_FRAME_UNSPECIFIED && request.has_block()) {
        return EditFrame::kIndex;
      }
      Refuse("the edit has no known frame: give EDIT_FRAME_WORLD or EDIT_FRAME_INDEX");
  }
}

EditOperation OperationOf(v1::EditOperation operation) {
  switch (operation) {
    case v1::EDIT_OPERATION_ADD:
      return EditOperation::kAdd;
    case v1::EDIT_OPERATION_SUBTRACT:
      return EditOperation::kSubtract;
    case v1::EDIT_OPERATION_SET:
      return EditOperation::kSet;
    case v1::EDIT_OPERATION_SMOOTH:
      return EditOperation::kSmooth;
    case v1::EDIT_OPERATION_PAINT:
      return EditOperation::kPaint;
    default:
      Refuse("the edit has no known operation: give add, subtract, set, smooth or paint");
  }
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
