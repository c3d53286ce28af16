// DeviceService: what the device is and how the servo loop runs.
#pragma once

#include "palpate/v1/device.grpc.pb.h"
#include "server/realtime/thread_setup.h"
#include "server/servo/servo_loop.h"

namespace palpate {

class DeviceService final : public v1::DeviceService::Service {
 public:
  // Borrows all.
  DeviceService(const DeviceSpec& spec, const ServoLoop& servo, const SceneInbox& inbox)
      : spec_(spec), servo_(servo), inbox_(inbox) {}

  grpc::Status GetDevice(grpc::ServerContext* context, const v1::GetDeviceRequest* request,
                         v1::GetDeviceResponse* response) override;

 private:
  const DeviceSpec& spec_;
  const ServoLoop& servo_;
  const SceneInbox& inbox_;
};

}  // namespace palpate
