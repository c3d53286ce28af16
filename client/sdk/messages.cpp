#include "client/sdk/messages.h"

#include <algorithm>
#include <bit>

#include "client/sdk/info_messages.h"
#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/limits.h"

namespace palpate::client {
namespace {

std::uint32_t Index(int value) {
  if (value < 0) throw Error(ErrorKind::kInvalidArgument, "a block outside of the volume");
  return static_cast<std::uint32_t>(value);
}

template <class Request>
void Set(Request& request, const Sphere& sphere) {
  *request.mutable_sphere()->mutable_center() = palpate::ToProto(sphere.center);
  request.mutable_sphere()->set_radius(sphere.radius);
}
template <class Request>
void Set(Request& request, const Box& box) {
  *request.mutable_box()->mutable_min() = palpate::ToProto(box.min);
  *request.mutable_box()->mutable_max() = palpate::ToProto(box.max);
}
void Set(v1::EditVolumeRequest& request, const Capsule& capsule) {
  *request.mutable_capsule()->mutable_from() = palpate::ToProto(capsule.from);
  *request.mutable_capsule()->mutable_to() = palpate::ToProto(capsule.to);
  request.mutable_capsule()->set_radius(capsule.radius);
}
void Set(v1::EditVolumeRequest& request, const Block& block) {
  // Checked here, before sending: the daemon cuts off a client whose message it refuses unread.
  if (block.values.size() * sizeof(float) > kMostBlockBytes) {
    throw Error(ErrorKind::kTooLarge, "a block has at most 3 MiB of values: send it in parts");
  }
  v1::DenseBlock& dense = *request.mutable_block();
  dense.set_min_x(Index(block.min.x()));
  dense.set_min_y(Index(block.min.y()));
  dense.set_min_z(Index(block.min.z()));
  dense.set_size_x(Index(block.size.x()));
  dense.set_size_y(Index(block.size.y()));
  dense.set_size_z(Index(block.size.z()));
  static_assert(std::endian::native == std::endian::little, "as on the wire");
  dense.mutable_values()->assign(reinterpret_cast<const char*>(block.values.data()),
                                 block.values.size() * sizeof(float));
}

}  // namespace

Pose FromProto(const v1::PoseSample& sample) {
  Pose pose;
  pose.tick = sample.tick();
  pose.time_ns = sample.time_ns();
  pose.hip_mm = palpate::FromProto(sample.hip_mm());
  pose.scp_h_mm = palpate::FromProto(sample.scp_h_mm());
  if (sample.has_scp_h_normal()) pose.scp_h_normal = palpate::FromProto(sample.scp_h_normal());
  if (sample.has_scp_v_mm()) pose.scp_v_mm = palpate::FromProto(sample.scp_v_mm());
  if (sample.has_scp_v_normal()) pose.scp_v_normal = palpate::FromProto(sample.scp_v_normal());
  pose.stylus_orientation = UnalignedQuaternion(palpate::FromProto(sample.stylus_orientation()));
  pose.buttons = sample.buttons();
  pose.force_n = palpate::FromProto(sample.force_n());
  pose.mode = EnumeratorOf<ProxyMode>(sample.mode());
  pose.contact = sample.contact();
  pose.density = sample.density();
  pose.isovalue = sample.isovalue();
  pose.settings_revision = sample.settings_revision();
  pose.volume_revision = sample.volume_revision();
  pose.update_ns = sample.update_ns();
  pose.missed_ticks = sample.missed_ticks();
  pose.iterations = sample.iterations();
  pose.capped_ticks = sample.capped_ticks();
  pose.free_side = EnumeratorOf<FreeSide>(sample.free_side());
  pose.forces = FromProto(sample.forces());
  pose.replayed = sample.replayed();
  return pose;
}

v1::EditVolumeRequest ToProto(const Edit& edit) {
  v1::EditVolumeRequest request;
  std::visit([&](const auto& shape) { Set(request, shape); }, edit.shape);
  const bool is_index = edit.frame == EditFrame::kIndex || request.has_block();
  request.set_frame(is_index ? v1::EDIT_FRAME_INDEX : static_cast<v1::EditFrame>(edit.frame));
  request.set_operation(static_cast<v1::EditOperation>(edit.operation));
  request.set_value(edit.value);
  request.set_strength(edit.strength);
  request.set_falloff(edit.falloff);
  if (edit.expected_revision) request.set_expected_revision(*edit.expected_revision);
  request.set_stroke(edit.stroke);
  return request;
}

v1::FilterVolumeRequest ToProto(const Filter& filter) {
  v1::FilterVolumeRequest request;
  request.set_kind(static_cast<v1::FilterKind>(filter.kind));
  // A negative width is sent as 0. The daemon refuses both.
  request.set_width(static_cast<std::uint32_t>(std::max(0, filter.width)));
  request.set_iterations(static_cast<std::uint32_t>(std::max(0, filter.iterations)));
  request.set_distance_mm(filter.distance_mm);
  *request.mutable_spacing_mm() = palpate::ToProto(filter.spacing_mm);
  if (const auto* sphere = std::get_if<Sphere>(&filter.region)) Set(request, *sphere);
  if (const auto* box = std::get_if<Box>(&filter.region)) Set(request, *box);
  request.set_frame(static_cast<v1::EditFrame>(filter.frame));
  if (filter.expected_revision) request.set_expected_revision(*filter.expected_revision);
  return request;
}

EditResult FromProto(const v1::EditVolumeResponse& response) {
  EditResult result;
  result.volume_revision = response.volume_revision();
  result.applied_tick = response.applied_tick();
  if (response.has_changed()) {
    const v1::IndexBox& box = response.changed();
    result.changed = IndexBox{Vec3i(box.min_x(), box.min_y(), box.min_z()),
                              Vec3i(box.max_x(), box.max_y(), box.max_z())};
  }
  result.changed_voxels = response.changed_voxels();
  result.undo_steps = response.undo_steps();
  result.redo_steps = response.redo_steps();
  return result;
}

}  // namespace palpate::client
