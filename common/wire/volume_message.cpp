#include "common/wire/volume_message.h"

#include <utility>

#include "common/error/error.h"
#include "common/error/text.h"
#include "common/wire/convert.h"
#include "common/wire/values.h"

namespace palpate {
namespace {

template <typename Message>
Vec3i SizeOf(const Message& message) {
  return {FromCount(message.size_x()), FromCount(message.size_y()), FromCount(message.size_z())};
}

template <typename Message>
void SetSize(Message& message, const Vec3i& size) {
  message.set_size_x(ToCount(size.x()));
  message.set_size_y(ToCount(size.y()));
  message.set_size_z(ToCount(size.z()));
}

LeafType LeafTypeOf(v1::VoxelType type) {
  for (const LeafType known : kLeafTypes) {
    if (VoxelTypeOf(known) == type) return known;
  }
  throw Error(ErrorKind::kInvalidArgument,
              "palpated sent voxels of a type that this version does not know: compare "
              "'palpated --version' with this program's");
}

void Put(VolumeLattice&& lattice, v1::StreamVolumeResponse& out) {
  v1::VolumeLattice& message = *out.mutable_lattice();
  message.set_source(Utf8(lattice.source));
  SetSize(message, lattice.size);
  *message.mutable_spacing_mm() = ToProto(lattice.spacing_mm);
  *message.mutable_world_from_index() = ToProto(lattice.X_WI);
  message.set_value_min(lattice.value_min);
  message.set_value_max(lattice.value_max);
  if (lattice.background) message.set_background(*lattice.background);
  message.set_unit(Utf8(lattice.unit));
  message.set_window_level(lattice.window_level);
  message.set_window_width(lattice.window_width);
  message.set_loaded_revision(lattice.loaded_revision);
  message.set_voxel_type(VoxelTypeOf(lattice.type));
}

void Put(const VolumePlacement& placement, v1::StreamVolumeResponse& out) {
  *out.mutable_placement() = ToProto(placement);
}

void Put(const VolumeOverview& overview, v1::StreamVolumeResponse& out) {
  *out.mutable_overview() = ToProto(overview);
}

void Put(VolumeBricks&& bricks, v1::StreamVolumeResponse& out) {
  *out.mutable_bricks() = ToProto(std::move(bricks));
}

void Put(VolumeComplete&& complete, v1::StreamVolumeResponse& out) {
  v1::VolumeComplete& message = *out.mutable_complete();
  *message.mutable_revision() = ToProto(complete.revision);
  message.set_content_hash_high(complete.content_hash.high);
  message.set_content_hash_low(complete.content_hash.low);
  message.set_background_hash_high(complete.background_hash.high);
  message.set_background_hash_low(complete.background_hash.low);
}

VolumeLattice Take(v1::VolumeLattice&& message) {
  return {
      .source = std::move(*message.mutable_source()),
      .size = SizeOf(message),
      .spacing_mm = FromProto(message.spacing_mm()),
      .X_WI = FromProto(message.world_from_index()),
      .value_min = message.value_min(),
      .value_max = message.value_max(),
      .background = message.has_background() ? std::optional(message.background()) : std::nullopt,
      .unit = std::move(*message.mutable_unit()),
      .window_level = message.window_level(),
      .window_width = message.window_width(),
      .loaded_revision = message.loaded_revision(),
      .type = LeafTypeOf(message.voxel_type())};
}

VolumeComplete Take(v1::VolumeComplete&& message) {
  return {FromProto(message.revision()),
          {message.content_hash_high(), message.content_hash_low()},
          {message.background_hash_high(), message.background_hash_low()}};
}

VolumeEvent TakeEvent(v1::StreamVolumeResponse& message) {
  switch (message.event_case()) {
    case v1::StreamVolumeResponse::kLattice:
      return Take(std::move(*message.mutable_lattice()));
    case v1::StreamVolumeResponse::kPlacement:
      if (message.placement().has_device_from_index()) return FromProto(message.placement());
      break;
    case v1::StreamVolumeResponse::kOverview:
      return FromProto(message.overview());
    case v1::StreamVolumeResponse::kBricks:
      return FromProto(std::move(*message.mutable_bricks()));
    case v1::StreamVolumeResponse::kComplete:
      return Take(std::move(*message.mutable_complete()));
    case v1::StreamVolumeResponse::EVENT_NOT_SET:
      break;
  }
  throw Error(ErrorKind::kInvalidArgument,
              "palpated sent an event of a volume that this version does not know: compare "
              "'palpated --version' with this program's");
}

}  // namespace

v1::VoxelType VoxelTypeOf(LeafType type) {
  switch (type) {
    case LeafType::kUint8:
      return v1::VOXEL_TYPE_UINT8;
    case LeafType::kInt16:
      return v1::VOXEL_TYPE_INT16;
    case LeafType::kUint16:
      return v1::VOXEL_TYPE_UINT16;
    case LeafType::kFloat:
      break;
  }
  return v1::VOXEL_TYPE_FLOAT32;
}

v1::VolumeBricks ToProto(VolumeBricks bricks) {
  v1::VolumeBricks message;
  message.mutable_brick_numbers()->Add(bricks.numbers.begin(), bricks.numbers.end());
  message.set_zstd_values(std::move(bricks.zstd_values));
  message.set_bricks_left(bricks.bricks_left);
  message.set_voxel_type(VoxelTypeOf(bricks.type));
  for (const VolumeTile& tile : bricks.tiles) {
    v1::VolumeTile& added = *message.add_tiles();
    added.set_first_brick(tile.bricks.first);
    added.set_bricks(tile.bricks.count);
    added.set_value(tile.value);
  }
  return message;
}

VolumeBricks FromProto(v1::VolumeBricks message) {
  VolumeBricks bricks{.type = LeafTypeOf(message.voxel_type()),
                      .numbers = {message.brick_numbers().begin(), message.brick_numbers().end()},
                      .zstd_values = std::move(*message.mutable_zstd_values()),
                      .tiles = {},
                      .bricks_left = message.bricks_left()};
  for (const v1::VolumeTile& tile : message.tiles()) {
    bricks.tiles.push_back({{tile.first_brick(), tile.bricks()}, tile.value()});
  }
  return bricks;
}

v1::StreamVolumeResponse ToProto(VolumeMessage message) {
  v1::StreamVolumeResponse out;
  out.set_message_number(message.number);
  std::visit([&](auto& event) { Put(std::move(event), out); }, message.event);
  return out;
}

VolumeMessage FromProto(v1::StreamVolumeResponse message) {
  return {message.message_number(), TakeEvent(message)};
}

}  // namespace palpate
