#include "client/cli/device_command.h"

#include <fmt/core.h>

#include <chrono>

#include "client/cli/connection.h"
#include "client/cli/device_description.h"
#include "client/cli/device_test.h"
#include "client/cli/output.h"
#include "client/cli/pose_stream.h"
#include "common/error/one_line.h"
#include "palpate/v1/device.grpc.pb.h"

namespace palpate::cli {
namespace {

using Stub = v1::DeviceService::Stub;
using Clock = std::chrono::steady_clock;

constexpr double kTestRateHz = 1000.0;
constexpr std::uint32_t kTestBatch = 16;
constexpr std::chrono::milliseconds kPoll(50);

template <typename Request, typename Response>
Response Call(const Connection& connection,
              grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
              const Request& request = {}) {
  return connection.Call(*v1::DeviceService::NewStub(connection.channel()), method, request);
}

// Of EnableForces, DisableForces, StopForces.
template <typename Response>
void PrintForces(const Response& response, bool json) {
  if (json) {
    Json object = ToJson(response.forces());
    object["applied_tick"] = response.applied_tick();
    WriteOutput(ToText(object));
    return;
  }
  std::string text = Describe(response.forces());
  AppendLine(text, "", fmt::format("since tick {}", response.applied_tick()));
  WriteOutput(text);
}

void Read(const Connection& connection, double seconds, DeviceTest& test) {
  PoseStream stream(connection, kTestRateHz, kTestBatch);
  v1::StreamPosesResponse message;
  const auto end = Clock::now() + std::chrono::duration<double>(seconds);
  while (Clock::now() < end) {
    const CallEvent event = stream.Next(kPoll, message);
    if (event == CallEvent::kEnded) throw connection.ErrorOfEnd(stream.status());
    if (event != CallEvent::kMessage) continue;
    for (const v1::PoseSample& sample : message.samples()) test.Add(sample);
  }
}

}  // namespace

void PrintDevices(const Connection& connection, bool json) {
  const v1::ListDevicesResponse list = Call(connection, &Stub::ListDevices);
  if (!json) {
    WriteOutput(Describe(list));
    return;
  }
  Json devices = Json::array();
  for (const v1::ListedDevice& device : list.devices()) devices.push_back(ToJson(device));
  WriteOutput(ToText({{"devices", devices}}));
}

void PrintDevice(const Connection& connection, bool json) {
  const v1::GetDeviceResponse response = Call(connection, &Stub::GetDevice);
  WriteOutput(json ? ToText({{"device", ToJson(response.device())},
                             {"health", ToJson(response.health())},
                             {"forces", ToJson(response.forces())}})
                   : Describe(response.device()) + Describe(response.health()) +
                         Describe(response.forces()));
}

void CalibrateDevice(const Connection& connection, bool json) {
  const v1::DeviceHealth health = Call(connection, &Stub::CalibrateDevice).health();
  WriteOutput(json ? ToText(ToJson(health)) : Describe(health));
}

void EnableForces(const Connection& connection, const std::string& name, bool json) {
  v1::EnableForcesRequest request;
  request.set_device(name);
  PrintForces(Call(connection, &Stub::EnableForces, request), json);
}

void DisableForces(const Connection& connection, bool json) {
  PrintForces(Call(connection, &Stub::DisableForces), json);
}

void StopForces(const Connection& connection, bool json) {
  PrintForces(Call(connection, &Stub::StopForces), json);
}

void TestDevice(const Connection& connection, double seconds, bool json) {
  DeviceTest test(Call(connection, &Stub::GetDevice));
  Read(connection, seconds, test);
  const v1::GetDeviceResponse after = Call(connection, &Stub::GetDevice);
  const DeviceTestFigures figures = test.Figures(after);
  if (json) {
    Json object = {{"device", ToJson(after.device())}};
    object.update(ToJson(figures));
    WriteOutput(ToText(object));
  } else {
    WriteOutput(Describe(after.device()) + Describe(figures));
  }
  if (!figures.failures.empty()) {
    throw Error(ErrorKind::kInternal,
                "the device failed its test: " + OneLine(figures.failures.front()));
  }
}

}  // namespace palpate::cli
