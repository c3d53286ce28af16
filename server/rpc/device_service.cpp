#include "server/rpc/device_service.h"

#include <algorithm>
#include <chrono>

#include "common/error/error.h"
#include "common/wire/force_words.h"
#include "common/wire/status.h"
#include "server/rpc/device_messages.h"
#include "server/safety/names.h"

namespace palpate {
namespace {

constexpr std::chrono::seconds kTickPatience{1};

v1::ForceStatus ToProto(const ForceTick& forces) {
  return palpate::ToProto(forces.state, forces.reason, forces.limit_n);
}

bool ForcesAreKnown(const DeviceSpec& spec) {
  return spec.verification_level == VerificationLevel::kForceVerified || !IsHardware(spec);
}

// Of several devices of one kind the daemon has the one that works.
int IndexInUse(const std::vector<ListedDevice>& devices, const std::string& kind) {
  const auto is_ours = [&](const ListedDevice& d) { return d.kind == kind; };
  const bool alone = std::count_if(devices.begin(), devices.end(), is_ours) == 1;
  for (std::size_t n = 0; n < devices.size(); ++n) {
    if (is_ours(devices[n]) && (alone || devices[n].problem.empty())) return static_cast<int>(n);
  }
  return -1;
}

template <typename Response>
void Answer(const ForceTick& forces, Response& response) {
  *response.mutable_forces() = ToProto(forces);
  response.set_applied_tick(forces.since_tick);
}

}  // namespace

grpc::Status DeviceService::GetDevice(grpc::ServerContext*, const v1::GetDeviceRequest*,
                                      v1::GetDeviceResponse* response) {
  *response->mutable_device() = palpate::ToProto(device_.spec());
  *response->mutable_health() = palpate::ToProto(device_.health());
  if (const auto forces = forces_.newest()) *response->mutable_forces() = ToProto(*forces);
  v1::ServoDescription* servo = response->mutable_servo();
  servo->set_rate_hz(ServoLoop::kRateHz);
  servo->set_realtime_scheduling(servo_.grant().fifo);
  servo->set_memory_locked(servo_.grant().memory_locked);
  for (const std::string& warning : servo_.grant().warnings) servo->add_warnings(warning);
  servo->set_ticks(servo_.ticks());
  servo->set_missed_ticks(servo_.missed_ticks());
  servo->set_scenes_applied(inbox_.announced());
  servo->set_version(PALPATE_VERSION);
  servo->set_faulty_ticks(servo_.faulty_ticks());
  servo->set_page_faults(servo_.page_faults());
  servo->set_lost_samples(servo_.lost_samples());
  return grpc::Status::OK;
}

grpc::Status DeviceService::ListDevices(grpc::ServerContext*, const v1::ListDevicesRequest*,
                                        v1::ListDevicesResponse* response) {
  try {
    const std::vector<ListedDevice> devices = list_();
    for (const ListedDevice& device : devices) {
      *response->add_devices() = palpate::ToProto(device);
    }
    const int in_use = IndexInUse(devices, device_.spec().kind);
    if (in_use >= 0) response->mutable_devices(in_use)->set_in_use(true);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

grpc::Status DeviceService::EnableForces(grpc::ServerContext*,
                                         const v1::EnableForcesRequest* request,
                                         v1::EnableForcesResponse* response) {
  try {
    CheckName(request->device());
    const ForceTick forces = Command(ForceCommand::kEnable);
    CheckEnabled(forces);
    Answer(forces, *response);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

grpc::Status DeviceService::DisableForces(grpc::ServerContext*, const v1::DisableForcesRequest*,
                                          v1::DisableForcesResponse* response) {
  try {
    Answer(Command(ForceCommand::kDisable), *response);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

grpc::Status DeviceService::StopForces(grpc::ServerContext*, const v1::StopForcesRequest*,
                                       v1::StopForcesResponse* response) {
  try {
    Answer(Command(ForceCommand::kStop), *response);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

grpc::Status DeviceService::CalibrateDevice(grpc::ServerContext*, const v1::CalibrateDeviceRequest*,
                                            v1::CalibrateDeviceResponse* response) {
  try {
    const DeviceHealth health = device_.health();
    if (health.connection != DeviceConnection::kStreaming) {
      throw Error(ErrorKind::kFailedPrecondition,
                  "the device `" + device_.spec().kind + "` is not there to be calibrated: " +
                      (health.problem.empty() ? "it is being set up, try again" : health.problem));
    }
    CheckForcesAreOff();
    device_.Calibrate();
    *response->mutable_health() = palpate::ToProto(device_.health());
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

void DeviceService::CheckName(const std::string& name) const {
  const DeviceSpec& spec = device_.spec();
  // The name is the client's, of any length and content: it is not told back.
  if (!name.empty() && name != spec.kind) {
    throw Error(ErrorKind::kInvalidArgument, "the daemon's device is `" + spec.kind +
                                                 "`, not the one named: 'palpate device " +
                                                 "enable " + spec.kind + "' enables its forces");
  }
  if (name.empty() && !ForcesAreKnown(spec)) {
    throw Error(ErrorKind::kInvalidArgument,
                "the forces of `" + spec.kind +
                    "` were never verified on hardware and may go anywhere: if you take that on, "
                    "enable them by its name, with 'palpate device enable " +
                    spec.kind + "'");
  }
}

// The command, and a tick that certainly knows it. Another command may have come
// between: the tick tells what holds.
ForceTick DeviceService::Command(ForceCommand command) {
  servo_.forces().Set(command);
  // The tick that runs now may have looked before; the next one has not.
  const std::uint64_t taken = servo_.ticks() + 1;
  if (const auto forces = forces_.WaitForTick(taken, kTickPatience)) return *forces;
  // Whoever asked for forces may be gone when they would come.
  const bool holds = command != ForceCommand::kEnable;
  if (!holds) servo_.forces().Withdraw(command);
  throw Error(ErrorKind::kUnavailable,
              "the haptic loop did not tick within 1 s: the command to " +
                  std::string(NameOf(command)) + " forces " +
                  (holds ? "holds from its next tick on" : "was taken back") +
                  "; look at palpated's log, or end it");
}

// Positions jump when they get another zero, and forces with them.
void DeviceService::CheckForcesAreOff() const {
  const std::optional<ForceTick> forces = forces_.newest();
  if (!forces || !IsHardware(device_.spec())) return;
  if (forces->state != ForceState::kRampIn && forces->state != ForceState::kOn) return;
  throw Error(ErrorKind::kFailedPrecondition,
              "forces are on: disable them first, with 'palpate device disable'");
}

void DeviceService::CheckEnabled(const ForceTick& forces) const {
  if (forces.state == ForceState::kRampIn || forces.state == ForceState::kOn ||
      forces.state == ForceState::kHeld) {
    return;
  }
  const std::string problem =
      forces.reason == ForceReason::kDevice ? device_.health().problem : std::string();
  const std::string state = forces.state == ForceState::kFault ? "a fault"
                            : forces.state == ForceState::kOff ? "disabled at the same time"
                                                               : "stopped";
  throw Error(ErrorKind::kFailedPrecondition,
              "forces stay off (" + state +
                  "): " + (problem.empty() ? InWords(ToProto(forces).reason()) : problem));
}

}  // namespace palpate
