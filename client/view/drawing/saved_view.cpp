#include "client/view/drawing/saved_view.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>
#include <vector>

namespace palpate::view {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostViews = 100;
constexpr std::size_t kMostNameBytes = 200;

double ScaleOf(const AffineMap& X_DW) { return std::cbrt(std::abs(X_DW.linear.determinant())); }

template <class Matrix>
Json Numbers(const Matrix& matrix) {
  return std::vector<double>(matrix.data(), matrix.data() + matrix.size());
}

double Number(const Json& json) {
  const auto number = json.get<double>();
  if (!std::isfinite(number)) throw std::invalid_argument("not finite");
  return number;
}

template <class Matrix>
Matrix Read(const Json& json) {
  Matrix matrix;
  if (!json.is_array() || json.size() != static_cast<std::size_t>(matrix.size())) {
    throw std::invalid_argument("another count of numbers");
  }
  for (int n = 0; n < matrix.size(); ++n)
    matrix.data()[n] = Number(json[static_cast<std::size_t>(n)]);
  return matrix;
}

Json ToJson(const SavedView& view) {
  Json planes = Json::array();
  for (const ClipPlane& plane : view.planes) {
    planes.push_back({{"on", plane.on},
                      {"normal", Numbers(plane.normal_I)},
                      {"offset_voxels", plane.offset_voxels}});
  }
  return {{"name", view.name},
          {"target_mm", Numbers(view.target_W)},
          {"upright", Numbers(view.R_WU)},
          {"azimuth_deg", view.azimuth_deg},
          {"elevation_deg", view.elevation_deg},
          {"distance_mm", view.distance_mm},
          {"crop_min", Numbers(view.crop.min)},
          {"crop_max", Numbers(view.crop.max)},
          {"planes", planes},
          {"window", {view.window_min, view.window_max}},
          {"cross_voxels", Numbers(view.cross_I)},
          {"saved_s", view.saved_s}};
}

bool IsUsable(const SavedView& view) {
  const bool is_rotation =
      (view.R_WU * view.R_WU.transpose()).isIdentity(1e-6) && view.R_WU.determinant() > 0.0;
  const bool is_box = (view.crop.min.array() >= 0.0).all() &&
                      (view.crop.max.array() <= 1.0).all() &&
                      (view.crop.min.array() < view.crop.max.array()).all();
  return is_rotation && is_box && view.distance_mm > 0.0 && view.window_min < view.window_max;
}

SavedView FromJson(const Json& json) {
  SavedView view{.name = json.at("name").get<std::string>().substr(0, kMostNameBytes),
                 .target_W = Read<Vec3>(json.at("target_mm")),
                 .R_WU = Read<Mat3>(json.at("upright")),
                 .azimuth_deg = Number(json.at("azimuth_deg")),
                 .elevation_deg = Number(json.at("elevation_deg")),
                 .distance_mm = Number(json.at("distance_mm")),
                 .crop = {Read<Vec3>(json.at("crop_min")), Read<Vec3>(json.at("crop_max"))},
                 .planes = {},
                 .window_min = Number(json.at("window").at(0)),
                 .window_max = Number(json.at("window").at(1)),
                 .cross_I = Read<Vec3>(json.at("cross_voxels")),
                 .saved_s = json.value("saved_s", std::int64_t{0})};
  for (std::size_t n = 0; n < view.planes.size(); ++n) {
    const Json& plane = json.at("planes").at(n);
    view.planes[n] = {.on = plane.at("on").get<bool>(),
                      .normal_I = Read<Vec3>(plane.at("normal")).normalized(),
                      .offset_voxels = Number(plane.at("offset_voxels"))};
    if (!view.planes[n].normal_I.allFinite() || view.planes[n].normal_I.isZero()) {
      throw std::invalid_argument("no direction");
    }
  }
  if (!IsUsable(view)) throw std::invalid_argument("no view");
  return view;
}

}  // namespace

SavedView SaveView(std::string name, const Camera& camera, const SurfaceOptions& surface,
                   const Vec3& cross_I, const AffineMap& X_DW) {
  const double scale = ScaleOf(X_DW);
  return {.name = std::move(name),
          .target_W = X_DW.Inverse().Apply(camera.target()),
          .R_WU = (X_DW.linear / scale).transpose() * camera.upright(),
          .azimuth_deg = camera.azimuth_deg(),
          .elevation_deg = camera.elevation_deg(),
          .distance_mm = camera.distance_mm() / scale,
          .crop = surface.crop,
          .planes = surface.planes,
          .window_min = surface.window_min,
          .window_max = surface.window_max,
          .cross_I = cross_I,
          .saved_s = 0};
}

void ShowView(const SavedView& view, const AffineMap& X_DW, Camera& camera, SurfaceOptions& surface,
              Vec3& cross_I) {
  const double scale = ScaleOf(X_DW);
  camera.SetUpright(X_DW.linear / scale * view.R_WU);
  camera.Set(X_DW.Apply(view.target_W), view.azimuth_deg, view.elevation_deg,
             view.distance_mm * scale);
  surface.crop = view.crop;
  surface.planes = view.planes;
  surface.window_min = view.window_min;
  surface.window_max = view.window_max;
  cross_I = view.cross_I;
}

std::string JsonOf(const std::vector<SavedView>& views) {
  Json all = Json::array();
  for (const SavedView& view : views) all.push_back(ToJson(view));
  // Names come from a keyboard: what is no UTF-8 is replaced.
  return all.dump(1, ' ', false, Json::error_handler_t::replace);
}

std::vector<SavedView> ViewsOf(std::string_view json) {
  const Json all = Json::parse(json, nullptr, false);
  std::vector<SavedView> views;
  if (!all.is_array()) return views;
  for (const Json& one : all) {
    if (views.size() == kMostViews) break;
    try {
      views.push_back(FromJson(one));
    } catch (const std::exception&) {
      // This one is damaged.
    }
  }
  return views;
}

}  // namespace palpate::view
