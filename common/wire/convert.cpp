#include "common/wire/convert.h"

#include <limits>
#include <string>

#include "common/error/error.h"

namespace palpate {

v1::Vector3 ToProto(const Vec3& vector) {
  v1::Vector3 message;
  message.set_x(vector.x());
  message.set_y(vector.y());
  message.set_z(vector.z());
  return message;
}

v1::Quaternion ToProto(const Eigen::Quaterniond& rotation) {
  v1::Quaternion message;
  message.set_w(rotation.w());
  message.set_x(rotation.x());
  message.set_y(rotation.y());
  message.set_z(rotation.z());
  return message;
}

v1::AffineMap ToProto(const AffineMap& map) {
  v1::AffineMap message;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      message.add_linear(map.linear(row, column));
    }
  }
  *message.mutable_translation() = ToProto(map.translation);
  return message;
}

Vec3 FromProto(const v1::Vector3& vector) { return {vector.x(), vector.y(), vector.z()}; }

Eigen::Quaterniond FromProto(const v1::Quaternion& rotation) {
  return {rotation.w(), rotation.x(), rotation.y(), rotation.z()};
}

AffineMap FromProto(const v1::AffineMap& map) {
  if (map.linear_size() != 9) {
    throw Error(ErrorKind::kInvalidArgument,
                "an affine map has nine linear values, not " + std::to_string(map.linear_size()));
  }
  AffineMap result;
  for (int i = 0; i < 9; ++i) {
    result.linear(i / 3, i % 3) = map.linear(i);
  }
  result.translation = FromProto(map.translation());
  return result;
}

int FromCount(std::uint32_t count) {
  if (count > static_cast<std::uint32_t>(std::numeric_limits<int>::max())) {
    throw Error(ErrorKind::kInvalidArgument, std::to_string(count) + " voxels are too many");
  }
  return static_cast<int>(count);
}

std::uint32_t ToCount(int count) {
  if (count < 0) {
    throw Error(ErrorKind::kInvalidArgument,
                std::to_string(count) + " is no number of voxels and no index of one");
  }
  return static_cast<std::uint32_t>(count);
}

}  // namespace palpate
