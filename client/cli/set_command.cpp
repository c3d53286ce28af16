#include "client/cli/set_command.h"

#include <fmt/core.h>

#include "client/cli/connection.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/setting.h"
#include "palpate/v1/render.grpc.pb.h"

namespace palpate::cli {
namespace {

std::string DescribeValue(const std::string& field, const v1::RenderSettings& settings) {
  if (field == "normalized_isovalue") {
    return fmt::format("isovalue {:.9g} (normalised {:.9g})", settings.isovalue(),
                       settings.normalized_isovalue());
  }
  const Setting* setting = FindSetting(field);
  return setting ? DescribeSetting(*setting, settings) : field;
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
