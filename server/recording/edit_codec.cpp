#include "server/recording/edit_codec.h"

#include <array>
#include <cstring>
#include <memory>
#include <utility>

#include "common/error/error.h"
#include "server/recording/bytes.h"

namespace palpate {
namespace {

constexpr std::size_t kPlanes = sizeof(float);

}  // namespace

std::string EncodeEdit(const RecordedEdit& edit) {
  if (edit.bricks.empty() || edit.bricks.size() > kBricksPerEdit) {
    throw Error(ErrorKind::kInvalidArgument, "an edit of a recording holds 1 to 4096 bricks");
  }
  ByteWriter writer;
  writer.Put(edit.tick);
  writer.Put(edit.base_revision);
  writer.Put(edit.volume_revision);
  writer.Put(static_cast<std::uint32_t>(edit.bricks.size()));
  for (const RecordedBrick& brick : edit.bricks) writer.Put(brick.number);
  const std::size_t voxels = edit.bricks.size() * kBrickVoxels;
  std::string planes(voxels * kPlanes, '\0');
  std::size_t at = 0;
  for (const RecordedBrick& brick : edit.bricks) {
    for (const float value : brick.values->Floats()) {
      std::array<char, kPlanes> bytes;
      std::memcpy(bytes.data(), &value, kPlanes);
      for (std::size_t plane = 0; plane < kPlanes; ++plane) {
        planes[plane * voxels + at] = bytes[plane];
      }
      ++at;
    }
  }
  writer.PutBytes(planes);
  return std::move(writer).Take();
}

RecordedEdit DecodeEdit(std::string_view bytes) {
  ByteReader reader(bytes);
  RecordedEdit edit;
  edit.tick = reader.Get<std::uint64_t>();
  edit.base_revision = reader.Get<std::uint64_t>();
  edit.volume_revision = reader.Get<std::uint64_t>();
  const auto count = reader.Get<std::uint32_t>();
  if (count == 0 || count > kBricksPerEdit) throw DamagedBytes("damaged: too many bricks");
  edit.bricks.resize(count);
  for (std::size_t n = 0; n < count; ++n) {
    edit.bricks[n].number = reader.Get<std::uint64_t>();
    if (n > 0 && edit.bricks[n].number <= edit.bricks[n - 1].number) {
      throw DamagedBytes("damaged: its bricks are out of order");
    }
  }
  const std::size_t voxels = std::size_t{count} * kBrickVoxels;
  const std::string_view planes = reader.GetBytes(voxels * kPlanes);
  reader.ExpectEnd();
  std::size_t at = 0;
  for (RecordedBrick& brick : edit.bricks) {
    Brick values;
    for (float& value : values) {
      std::array<char, kPlanes> voxel;
      for (std::size_t plane = 0; plane < kPlanes; ++plane) {
        voxel[plane] = planes[plane * voxels + at];
      }
      std::memcpy(&value, voxel.data(), kPlanes);
      ++at;
    }
    brick.values = Leaf::Smallest(values);
  }
  return edit;
}

}  // namespace palpate
