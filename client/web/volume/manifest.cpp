#include "client/web/volume/manifest.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <exception>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "client/web/volume/blob.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

// `to`: the first voxel of the brick in the group.
template <class T>
void CopyBrick(const TypedBrick& brick, T* to) {
  VisitType(brick.type(), [&](auto voxel) {
    using S = decltype(voxel);
    const S* const values = brick.values<S>();
    for (int row = 0; row < kBrickEdge * kBrickEdge; ++row) {
      T* const line =
          to + (row / kBrickEdge) * kGroupEdge * kGroupEdge + (row % kBrickEdge) * kGroupEdge;
      if (brick.is_constant()) {
        std::fill_n(line, kBrickEdge, static_cast<T>(*values));
      } else {
        const S* const from = values + row * kBrickEdge;
        for (int k = 0; k < kBrickEdge; ++k) line[k] = static_cast<T>(from[k]);
      }
    }
  });
}

}  // namespace

Group::Group(const BrickMap& map, const Vec3i& group, const TypedBrickPtr& background) {
  for (std::size_t n = 0; n < bricks_.size(); ++n) {
    const auto place = static_cast<int>(n);
    const Vec3i brick = group * kGroupBricks + Vec3i(place >> 4, place >> 2 & 3, place & 3);
    const bool is_within = (brick.array() < map.brick_count().array()).all();
    bricks_.at(n) = is_within ? map.At(brick) : background;
    type_ = CommonType(type_, bricks_.at(n)->type());
  }
}

std::string Group::Bytes(LeafType type) const {
  std::string bytes(kGroupVoxels * VoxelBytes(type), '\0');
  VisitType(type, [&](auto voxel) {
    auto* const voxels = reinterpret_cast<decltype(voxel)*>(bytes.data());
    for (std::size_t n = 0; n < bricks_.size(); ++n) {
      const std::size_t first =
          ((n >> 4) * kGroupEdge * kGroupEdge + (n >> 2 & 3) * kGroupEdge + (n & 3)) * kBrickEdge;
      CopyBrick(*bricks_.at(n), voxels + first);
    }
  });
  return bytes;
}

bool AreAll(std::string_view bytes, LeafType type, float value) {
  return VisitType(type, [&](auto voxel) {
    voxel = static_cast<decltype(voxel)>(value);
    return std::memcmp(bytes.data(), &voxel, sizeof(voxel)) == 0 &&
           std::memcmp(bytes.data(), bytes.data() + sizeof(voxel), bytes.size() - sizeof(voxel)) ==
               0;
  });
}

namespace {

using Json = nlohmann::ordered_json;

constexpr std::byte kManifestKind{255};
constexpr std::size_t kHashBytes = 16;
constexpr double kMostVoxels = 0x1p36;

std::span<const std::byte> AsBytes(std::string_view text) { return std::as_bytes(std::span(text)); }

Json RowOf(const Vec3i& v) { return {v.x(), v.y(), v.z()}; }

Vec3i SizeOf(const Json& row) {
  if (row.size() != 3) Refuse("no size");
  const Vec3i size(row.at(0).get<int>(), row.at(1).get<int>(), row.at(2).get<int>());
  if (size.minCoeff() < 1 || size.cast<double>().prod() > kMostVoxels) Refuse("no size");
  return size;
}

ContentHash NameIn(const Json& text) {
  const auto hash = ParseName(text.get<std::string>());
  if (!hash) Refuse("no name");
  return *hash;
}

LeafType TypeIn(const Json& text) {
  for (const LeafType type : kLeafTypes) {
    if (Name(type) == text.get<std::string>()) return type;
  }
  Refuse("no voxel type");
}

std::size_t GroupsOf(const Vec3i& size) {
  std::size_t groups = 1;
  for (const int voxels : size) groups *= GroupCount(BrickCount(voxels));
  return groups;
}

std::vector<ContentHash> GroupsIn(const std::string& base64, std::size_t count) {
  const std::string bytes = FromBase64(base64);
  if (!bytes.empty() && bytes.size() != count * kHashBytes) Refuse("other groups than voxels");
  std::vector<ContentHash> groups;
  groups.reserve(bytes.size() / kHashBytes);
  for (std::size_t at = 0; at < bytes.size(); at += kHashBytes) {
    groups.push_back(HashOf(std::string_view(bytes).substr(at, kHashBytes)));
  }
  return groups;
}

Manifest Parse(std::string_view text) {
  const Json json = Json::parse(text);
  const Json& lattice = json.at("lattice");
  Manifest manifest;
  manifest.size = SizeOf(lattice.at("size"));
  manifest.type = TypeIn(lattice.at("voxel_type"));
  manifest.overview = NameIn(json.at("overview").at("name"));
  manifest.groups = GroupsIn(json.at("groups").get<std::string>(), GroupsOf(manifest.size));
  return manifest;
}

}  // namespace

std::string ToJson(const Manifest& manifest) {
  std::string groups;
  groups.reserve(manifest.groups.size() * kHashBytes);
  for (const ContentHash& hash : manifest.groups) {
    const auto bytes = BytesOf(hash);
    groups.append(bytes.data(), bytes.size());
  }
  return Json{{"lattice",
               {{"size", RowOf(manifest.size)},
                {"voxel_type", Name(manifest.type)},
                {"background", manifest.background},
                {"value_min", manifest.value_min},
                {"value_max", manifest.value_max},
                {"factor", 1}}},
              {"revision", manifest.revision.volume_revision},
              {"daemon_id", std::to_string(manifest.revision.daemon_id)},
              {"content_hash", NameOf(manifest.content_hash)},
              {"overview",
               {{"name", NameOf(manifest.overview)},
                {"size", RowOf(manifest.overview_size)},
                {"factor", manifest.overview_factor}}},
              {"groups", Base64(groups)}}
      .dump();
}

Manifest ParseManifest(std::string_view json) {
  try {
    return Parse(json);
  } catch (const std::exception& error) {
    throw Error(ErrorKind::kInvalidArgument, std::string("no manifest: ") + error.what());
  }
}

ContentHash HashOfManifest(std::string_view json) {
  return HashOfBytes(kManifestKind, AsBytes(json));
}

ContentHash HashOfVoxels(LeafType type, std::string_view bytes) {
  return HashOfBytes(static_cast<std::byte>(type), AsBytes(bytes));
}

}  // namespace palpate::web
