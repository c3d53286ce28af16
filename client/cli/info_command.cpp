#include "client/cli/info_command.h"

#include "client/cli/connection.h"
#include "client/cli/description.h"
#include "client/cli/device_description.h"
#include "client/cli/output.h"
#include "client/sdk/setting_messages.h"
#include "common/error/one_line.h"
#include "palpate/v1/device.grpc.pb.h"
#include "palpate/v1/render.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::cli {
namespace {

client::Settings GetSettings(const Connection& connection) {
  const v1::GetSettingsResponse response =
      connection.Call(*v1::RenderService::NewStub(connection.channel()),
                      &v1::RenderService::Stub::GetSettings, v1::GetSettingsRequest());
  return client::FromProto(response.settings(), response.settings_revision());
}

}  // namespace

void PrintInfo(const Connection& connection, bool json) {
  const v1::GetDeviceResponse device =
      connection.Call(*v1::DeviceService::NewStub(connection.channel()),
                      &v1::DeviceService::Stub::GetDevice, v1::GetDeviceRequest());
  const v1::VolumeDescription volume =
      connection
          .Call(*v1::VolumeService::NewStub(connection.channel()),
                &v1::VolumeService::Stub::GetVolume, v1::GetVolumeRequest())
          .volume();
  const client::Settings settings = GetSettings(connection);
  if (json) {
    const Json info = {{"version", device.servo().version()}, {"server", connection.name()},
                       {"caller", ToJson(device.caller())},   {"device", ToJson(device.device())},
                       {"health", ToJson(device.health())},   {"forces", ToJson(device.forces())},
                       {"servo", ToJson(device.servo())},     {"volume", ToJson(volume)},
                       {"settings", ToJson(settings)}};
    WriteOutput(ToText(info, 2));
    return;
  }
  WriteOutput("palpated " + OneLine(device.servo().version()) + " at " + connection.name() + "\n" +
              Describe(device.caller()) + Describe(device.device()) + Describe(device.health()) +
              Describe(device.forces()) + Describe(device.servo()) + Describe(volume) +
              DescribeWarnings(volume) + Describe(settings));
}

void PrintSettings(const Connection& connection, bool json) {
  const client::Settings settings = GetSettings(connection);
  WriteOutput(json ? ToText(ToJson(settings)) : Describe(settings));
}

}  // namespace palpate::cli
