#include "server/volume/load/builtin.h"

#include <openvdb/tools/Dense.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/volume/snapshot/openvdb_grids.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace palpate {
namespace {

constexpr std::string_view kPrefix = "builtin:";
constexpr int kDefaultEdge = 128;
constexpr int kMinEdge = 8;
constexpr int kMaxEdge = 1024;

using Field = std::function<double(const Vec3& p)>;  // p in voxels

double FromDistance(double s) { return std::clamp(0.5 - s / 8.0, 0.0, 1.0); }

Field SphereField(int n) {
  const Vec3 c = Vec3::Constant((n - 1) / 2.0);
  return [=](const Vec3& p) { return FromDistance((p - c).norm() - 0.35 * n); };
}

Field BumpsField(int n) {
  const Vec3 c = Vec3::Constant((n - 1) / 2.0);
  const double k = 2.0 * std::numbers::pi / (n / 8.0);
  return [=](const Vec3& p) {
    const double bumps = std::sin(k * p.x()) * std::sin(k * p.y()) * std::sin(k * p.z());
    return FromDistance((p - c).norm() - 0.39 * n - (n / 128.0) * bumps);
  };
}

Field GyroidField(int n) {
  const double k = 2.0 * std::numbers::pi / (n / 4.0);
  return [=](const Vec3& p) {
    const Vec3 q = k * p;
    const double s = std::sin(q.x()) * std::cos(q.y()) + std::sin(q.y()) * std::cos(q.z()) +
                     std::sin(q.z()) * std::cos(q.x());
    return FromDistance(s / (1.5 * k));
  };
}

double CylinderField(const Vec3& p) {
  const double radius = std::hypot(p.x() - 49.5, p.y() - 49.5);
  return std::max(0.0, 1.0 - radius / 50.0);
}

// Parses "name[:N]"; without N, `edge` keeps its value.
std::string_view SplitEdge(std::string_view text, std::string_view source, int& edge) {
  const std::size_t colon = text.find(':');
  if (colon == std::string_view::npos) return text;
  const std::string_view digits = text.substr(colon + 1);
  const auto [end, status] = std::from_chars(digits.data(), digits.data() + digits.size(), edge);
  if (status != std::errc() || end != digits.data() + digits.size() || edge < kMinEdge ||
      edge > kMaxEdge) {
    throw Error(ErrorKind::kInvalidArgument,
                std::string(source) + ": the edge N must be a whole number from " +
                    std::to_string(kMinEdge) + " to " + std::to_string(kMaxEdge));
  }
  return text.substr(0, colon);
}

openvdb::FloatGrid::Ptr Sample(const Vec3i& size, const Field& field,
                               const std::function<bool()>& cancelled) {
  const auto stop_if_cancelled = [&] {
    if (cancelled && cancelled()) throw Error(ErrorKind::kCancelled, "loading was cancelled");
  };
  std::vector<float> voxels(static_cast<std::size_t>(size.x()) * size.y() * size.z());
  tbb::parallel_for(0, size.x(), [&](int i) {
    stop_if_cancelled();
    float* voxel = voxels.data() + static_cast<std::size_t>(i) * size.y() * size.z();
    for (int j = 0; j < size.y(); ++j) {
      for (int k = 0; k < size.z(); ++k) *voxel++ = static_cast<float>(field(Vec3(i, j, k)));
    }
  });
  const openvdb::CoordBBox box(openvdb::Coord(0),
                               openvdb::Coord(size.x() - 1, size.y() - 1, size.z() - 1));
  const openvdb::tools::Dense<const float, openvdb::tools::LayoutZYX> dense(box, voxels.data());
  stop_if_cancelled();
  auto grid = openvdb::FloatGrid::create(0.0f);
  openvdb::tools::copyFromDense(dense, *grid, 0.0f);
  return grid;
}

struct Recipe {
  Vec3i size;
  Field field;
};

Recipe RecipeOf(std::string_view source) {
  int edge = kDefaultEdge;
  const std::string_view text = source.substr(std::min(source.size(), kPrefix.size()));
  const std::string_view name = SplitEdge(text, source, edge);
  const Vec3i cube = Vec3i::Constant(edge);
  if (text == "cylinder") return {Vec3i(100, 100, 30), CylinderField};
  if (name == "sphere") return {cube, SphereField(edge)};
  if (name == "bumps") return {cube, BumpsField(edge)};
  if (name == "gyroid") return {cube, GyroidField(edge)};
  throw Error(ErrorKind::kInvalidArgument,
              std::string(source) +
                  ": no such builtin volume; there are builtin:cylinder, builtin:sphere[:N], "
                  "builtin:bumps[:N] and builtin:gyroid[:N]");
}

}  // namespace

bool IsBuiltin(std::string_view source) { return source.starts_with(kPrefix); }

Vec3i BuiltinSize(std::string_view source) { return RecipeOf(source).size; }

BuiltinVolume MakeBuiltin(std::string_view source, const Vec3& spacing_mm, std::int64_t max_voxels,
                          const std::function<bool()>& cancelled) {
  const auto [size, field] = RecipeOf(source);
  if (size.cast<std::int64_t>().prod() > max_voxels) {
    throw Error(ErrorKind::kTooLarge, std::string(source) + ": more than " +
                                          std::to_string(max_voxels) + " voxels; give a smaller N");
  }
  BuiltinVolume volume;
  volume.metadata.size = size;
  volume.metadata.spacing_mm = spacing_mm;
  volume.metadata.original_type = "float32";
  volume.metadata.source = std::string(source);
  volume.metadata.value_min = 0.0;  // until the values are known
  volume.metadata.value_max = 1.0;
  CheckVolumeMetadata(volume.metadata);
  volume.grid = Sample(size, field, cancelled);
  SetValueRange(*volume.grid, volume.metadata);
  return volume;
}

}  // namespace palpate
