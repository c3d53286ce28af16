#include "server/felt/patient_facing.h"

#include <algorithm>
#include <array>

#include "common/error/error.h"
#include "common/geometry/geometry.h"

namespace palpate {
namespace {

constexpr std::array<const char*, 6> kDirections = {"+x", "-x", "+y", "-y", "+z", "-z"};

Vec3 DirectionOf(const std::string& word, const char* field) {
  const auto found = std::find(kDirections.begin(), kDirections.end(), word);
  if (found == kDirections.end()) {
    Refuse(std::string("facing.") + field + " must be +x, -x, +y, -y, +z or -z, not '" + word +
           "'");
  }
  const auto place = found - kDirections.begin();
  return (place % 2 == 0 ? 1.0 : -1.0) * Vec3::Unit(place / 2);
}

}  // namespace

std::string PatientAxesOf(const PatientFacing& facing) {
  const Vec3 anterior = DirectionOf(facing.face, "face");
  const Vec3 superior = DirectionOf(facing.head, "head");
  const Vec3 left = superior.cross(anterior);
  if (left.isZero(0.0)) Refuse("face and head must point along two different axes");
  std::string axes;
  for (int axis = 0; axis < 3; ++axis) {
    for (const auto& [direction, letters] :
         {std::pair(left, "LR"), std::pair(anterior, "AP"), std::pair(superior, "SI")}) {
      if (direction[axis] != 0.0) axes += letters[direction[axis] > 0.0 ? 0 : 1];
    }
  }
  return axes;
}

bool IsAnsweredAxes(std::string_view axes) {
  for (const char* face : kDirections) {
    for (const char* head : kDirections) {
      if (face[1] != head[1] && PatientAxesOf({face, head}) == axes) return true;
    }
  }
  return false;
}

}  // namespace palpate
