#include "client/cli/set_command.h"

#include <fmt/format.h>

#include "client/cli/description.h"
#include "client/cli/output.h"
#include "palpate/v1/render.grpc.pb.h"

namespace palpate::cli {
namespace {

std::string DescribeValue(const std::string& field, const v1::RenderSettings& settings) {
  if (field == "isovalue") {
    return fmt::format("isovalue {:.9g}", settings.isovalue());
  }
  if (field == "normalized_isovalue") {
    return fmt::format("isovalue {:.9g} (normalised {:.9g})", settings.isovalue(),
                       settings.normalized_isovalue());
  }
  if (field == "stiffness_n_per_mm") {
    return fmt::format("stiffness {:.9g} N/mm", settings.stiffness_n_per_mm());
  }
  if (field == "damping_n_s_per_m") {
    return fmt::format("damping {:.9g} N·s/m", settings.damping_n_s_per_m());
  }
  return "method " + MethodName(settings.method());
}

}  // namespace

void ChangeSetting(const Connection& connection, const SetOptions& options) {
  v1::UpdateSettingsRequest request;
  *request.mutable_settings() = options.settings;
  request.mutable_update_mask()->add_paths(options.field);
  if (options.expected_revision) {
    request.set_expected_revision(*options.expected_revision);
  }
  const v1::UpdateSettingsResponse response =
      connection.Call(*v1::RenderService::NewStub(connection.channel()),
                      &v1::RenderService::Stub::UpdateSettings, request);
  if (!options.json) {
    WriteOutput(DescribeChange(options.field, response) + "\n");
    return;
  }
  Json json = ToJson(response.settings(), response.settings_revision());
  json["applied_tick"] = response.applied_tick();
  json["receipt_to_applied_ns"] = response.receipt_to_applied_ns();
  WriteOutput(ToText(json));
}

std::string DescribeChange(const std::string& field, const v1::UpdateSettingsResponse& response) {
  return fmt::format("{} applied at tick {}, settings revision {}, {:.1f} ms after receipt",
                     DescribeValue(field, response.settings()), response.applied_tick(),
                     response.settings_revision(),
                     static_cast<double>(response.receipt_to_applied_ns()) * 1e-6);
}

}  // namespace palpate::cli
