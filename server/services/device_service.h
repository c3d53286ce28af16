// DeviceService: describes the device and the servo loop, and lets an operator control the forces
// and lead the simulated hand.
//
// No command to the forces takes a lock of the session or waits longer than a second. The emergency
// stop also needs no thread for calls: gRPC's own threads, which never wait, carry it out. Once its
// sender is recognised, the stop is set before anything takes a lock, allocates or logs. On this
// machine it does not come here, but to a door of its own (server/stop/stop_door.h).
#pragma once

#include <chrono>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "common/contract/device.h"
#include "palpate/v1/device.grpc.pb.h"
#include "server/pump/tick_outbox.h"
#include "server/services/calls.h"
#include "server/services/lead_hand.h"
#include "server/servo/servo_loop.h"
#include "server/session/session.h"
#include "server/stop/stop_door.h"

namespace palpate {

// Called on any thread.
using DeviceList = std::function<std::vector<ListedDevice>()>;

class DeviceService final : public v1::DeviceService::CallbackService {
 public:
  // Borrows all arguments except the list. `hand`: null if the device is not the simulated one.
  DeviceService(Calls& calls, HapticDevice& device, LedHand* hand, ServoLoop& servo,
                StopDoor& stop_door, const SceneInbox& inbox, const Session& session,
                const ForceWatch& forces, DeviceList list)
      : calls_(calls),
        device_(device),
        hand_(hand),
        servo_(servo),
        stop_door_(stop_door),
        inbox_(inbox),
        session_(session),
        forces_(forces),
        list_(std::move(list)) {
    stop_door_.SetOnStop([this](const StopCaller& by) { NoteLocalStop(by); });
  }
  ~DeviceService() override { stop_door_.SetOnStop({}); }

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
  // Ends a push whose caller may push no more. Any thread; call it every second.
  void EndRevokedPush();

 private:
  void CheckName(const std::string& name) const;
  ForceTick Command(ForceCommand command);
  void Push(const Vec3& force_D_n, int ticks, const Credentials& by);
  // The command holds: remembers and logs its caller. `whose`: lines of the log. `more`: of the
  // caller, for the log.
  void Note(ForceCommand command, const Admission& by);
  void Note(ForceCommand command, const std::string& whose, const std::string& who,
            const std::string& more = {});
  void NoteLocalStop(const StopCaller& by);
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
  StopDoor& stop_door_;
  const SceneInbox& inbox_;
  const Session& session_;
  const ForceWatch& forces_;
  DeviceList list_;

  mutable std::mutex mutex_;  // guards the members below, and the servo's pushes
  std::string enabled_by_, disabled_by_, stopped_by_;
  Credentials pushed_by_;  // the newest push
  std::chrono::steady_clock::time_point pushes_until_{};
};

}  // namespace palpate
