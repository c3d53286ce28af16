#include "client/cli/set_command.h"

#include <fmt/core.h>

#include "client/cli/connection.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/sdk/setting_messages.h"
#include "palpate/v1/render.grpc.pb.h"

namespace palpate::cli {
namespace {

client::Settings SettingsOf(const v1::UpdateSettingsResponse& response) {
  return client::FromProto(response.settings(), response.settings_revision());
}

std::string DescribeValue(const Setting& setting, const client::Settings& settings) {
  if (&setting == &client::kNormalizedIsovalue) {
    return fmt::format("isovalue {:.9g} (normalised {:.9g})", settings.isovalue,
                       settings.normalized_isovalue);
  }
  return DescribeSetting(setting, settings);
}

}  // namespace

void ChangeSetting(const Connection& connection, const SetOptions& options) {
  const v1::UpdateSettingsResponse response =
      connection.Call(*v1::RenderService::NewStub(connection.channel()),
                      &v1::RenderService::Stub::UpdateSettings, client::ToProto(options.update));
  if (!options.json) {
    WriteOutput(DescribeChange(*options.setting, response) + "\n");
    return;
  }
  Json json = ToJson(SettingsOf(response));
  json["applied_tick"] = response.applied_tick();
  json["receipt_to_applied_ns"] = response.receipt_to_applied_ns();
  WriteOutput(ToText(json));
}

std::string DescribeChange(const Setting& setting, const v1::UpdateSettingsResponse& response) {
  return fmt::format("{} applied at tick {}, settings revision {}, {:.1f} ms after receipt",
                     DescribeValue(setting, SettingsOf(response)), response.applied_tick(),
                     response.settings_revision(),
                     static_cast<double>(response.receipt_to_applied_ns()) * 1e-6);
}

}  // namespace palpate::cli
