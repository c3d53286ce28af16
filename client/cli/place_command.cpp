#include "client/cli/place_command.h"

#include <fmt/core.h>

#include <charconv>
#include <cmath>
#include <numbers>

#include "client/cli/connection.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "palpate/v1/registration.grpc.pb.h"

namespace palpate::cli {
namespace {

constexpr double kDegreesPerRad = 180.0 / std::numbers::pi;

// "turned by 90° about (0, 1, 0)".
std::string DescribeTurn(const v1::Quaternion& q) {
  const double sine = std::hypot(q.x(), q.y(), q.z());
  const double degrees = 2.0 * std::atan2(sine, q.w()) * kDegreesPerRad;
  if (!(degrees > 1e-9)) return "not turned";
  // Adding 0 turns a negative zero into a plain one.
  const auto part = [&](double component) { return component / sine + 0.0; };
  return fmt::format("turned by {:.6g}° about ({:.4g}, {:.4g}, {:.4g})", degrees, part(q.x()),
                     part(q.y()), part(q.z()));
}

}  // namespace

void ShowPlace(const Connection& connection, bool json) {
  const v1::GetRegistrationResponse response = connection.Call(
      *v1::RegistrationService::NewStub(connection.channel()),
      &v1::RegistrationService::Stub::GetRegistration, v1::GetRegistrationRequest());
  if (!json) {
    WriteOutput(Describe(response.registration()) +
                fmt::format("          settings revision {}\n", response.settings_revision()));
    return;
  }
  Json object = ToJson(response.registration());
  object["settings_revision"] = response.settings_revision();
  WriteOutput(ToText(object));
}

void ChangePlace(const Connection& connection, const v1::UpdateRegistrationRequest& request,
                 bool json) {
  const v1::UpdateRegistrationResponse response =
      connection.Call(*v1::RegistrationService::NewStub(connection.channel()),
                      &v1::RegistrationService::Stub::UpdateRegistration, request);
  if (!json) {
    WriteOutput(Describe(response.registration()) +
                fmt::format("          applied at tick {}, settings revision {}\n",
                            response.applied_tick(), response.settings_revision()));
    return;
  }
  Json object = ToJson(response.registration());
  object["settings_revision"] = response.settings_revision();
  object["applied_tick"] = response.applied_tick();
  WriteOutput(ToText(object));
}

std::string Describe(const v1::Registration& registration) {
  const v1::Vector3& center = registration.center_mm();
  return fmt::format(
      "place     centre at {:.6g}, {:.6g}, {:.6g} mm of the device; {}\n"
      "          {:.6g} mm of the device per mm of the volume, {:.6g} per voxel: 1 mm is {:.6g} "
      "cells\n",
      center.x(), center.y(), center.z(), DescribeTurn(registration.rotation()),
      registration.device_mm_per_volume_mm(), registration.device_mm_per_voxel(),
      1.0 / registration.device_mm_per_voxel());
}

Json ToJson(const v1::Registration& registration) {
  const v1::Quaternion& q = registration.rotation();
  return {{"center_mm", ToJson(registration.center_mm())},
          {"rotation_wxyz", {q.w(), q.x(), q.y(), q.z()}},
          {"device_mm_per_volume_mm", registration.device_mm_per_volume_mm()},
          {"device_mm_per_voxel", registration.device_mm_per_voxel()}};
}

bool ParseTurn(std::string_view text, v1::Quaternion& rotation) {
  if (text.size() < 3 || text[1] != ',') return false;
  std::string_view number = text.substr(2);
  if (number.size() > 1 && number[0] == '+' && number[1] != '-') number.remove_prefix(1);
  double degrees = 0.0;
  const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), degrees);
  if (error != std::errc() || end != number.data() + number.size() || !std::isfinite(degrees)) {
    return false;
  }
  // Whole turns first: huge angles would lose all digits, and more than half a turn
  // is less the other way round.
  const double half_rad = std::remainder(degrees, 360.0) / kDegreesPerRad / 2.0;
  const double sine = std::sin(half_rad);
  rotation.Clear();
  rotation.set_w(std::cos(half_rad));
  switch (text[0]) {
    case 'x':
      rotation.set_x(sine);
      return true;
    case 'y':
      rotation.set_y(sine);
      return true;
    case 'z':
      rotation.set_z(sine);
      return true;
    default:
      return false;
  }
}

void Set(const std::vector<double>& values, v1::Vector3& vector) {
  vector.set_x(values[0]);
  vector.set_y(values[1]);
  vector.set_z(values[2]);
}

}  // namespace palpate::cli
