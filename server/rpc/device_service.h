// DeviceService: describes the device and the servo loop, and lets an operator control the forces
// and lead the simulated hand.
//
// No command to the forces takes a lock of the session or waits longer than a second. The emergency
// stop also needs no thread for calls: gRPC's own threads, which never wait, carry it out. Once its
// sender is recognised, the stop is set before anything takes a lock, allocates or logs. So it
// works whatever else the daemon does.
#pragma once

#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "common/contract/device.h"
#include "palpate/v1/device.grpc.pb.h"
#include "server/rpc/calls.h"
#include "server/rpc/lead_hand.h"
#include "server/samples/force_watch.h"
#include "server/servo/servo_loop.h"
#include "server/session/session.h"

namespace palpate {

// Called on any thread.
using DeviceList = std::function<std::vector<ListedDevice>()>;

class DeviceService final : public v1::DeviceService::CallbackService {
 public:
  // Borrows all arguments except the list. `hand`: null if the device is not the simulated one.
  DeviceService(Calls& calls, HapticDevice& device, LedHand* hand, ServoLoop& servo,
                const SceneInbox& inbox, const Session& session, const ForceWatch& forces,
                DeviceList list)
      : calls_(calls),
        device_(device),
        hand_(hand),
        servo_(servo),
        inbox_(inbox),
        session_(session),
        forces_(forces),
        list_(std::move(list)) {}

  Reply* GetDevice(CallContext* context, const v1::GetDeviceRequest* request,
                   v1::GetDeviceResponse* response) override;
  Reply* ListDevices(CallContext* context, const v1::ListDevicesRequest* request,
                     v1::ListDevicesResponse* response) override;
  Reply* EnableForces(CallContext* context, const v1::EnableForcesRequest* request,
                      v1::EnableForcesResponse* response) override;
  Reply* DisableForces(CallContext* context, const v1::DisableForcesRequest* request,
                       v1::DisableForcesResponse* response) override;
  Reply* StopForces(CallContext* context, const v1::StopForcesRequest* request,
                    v1::StopForcesResponse* response) override;
  Reply* PushHand(CallContext* context, const v1::PushHandRequest* request,
                  v1::PushHandResponse* response) override;
  Reply* CalibrateDevice(CallContext* context, const v1::CalibrateDeviceRequest* request,
                         v1::CalibrateDeviceResponse* response) override;
  LeadHandReactor* LeadHand(CallContext* context) override;

  // How the hand and the servo are now; any thread.
  HandsState Hands() const;

 private:
  void CheckName(const std::string& name) const;
  ForceTick Command(ForceCommand command);
  void Push(const Vec3& force_D_n, int ticks);
  // The command holds: remembers and logs its caller.
  void Note(ForceCommand command, const Admission& by);
  // Whose command made this state; empty: no client's.
  std::string SetBy(const ForceTick& forces) const;
  ServoDescription Servo() const;
  void CheckForcesAreOff() const;
  void CheckCalibrated(const std::string& name) const;
  void CheckEnabled(const ForceStatus& forces) const;

  Calls& calls_;
  HapticDevice& device_;
  LedHand* const hand_;
  ServoLoop& servo_;
  const SceneInbox& inbox_;
  const Session& session_;
  const ForceWatch& forces_;
  DeviceList list_;

  mutable std::mutex mutex_;  // guards the members below, and the servo's pushes
  std::string enabled_by_, disabled_by_, stopped_by_;
};

}  // namespace palpate
