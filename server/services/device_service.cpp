#include "server/services/device_service.h"

#include <fmt/format.h>
#include <grpcpp/alarm.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <utility>

#include "common/contract/enumerations.h"
#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "server/log/log.h"
#include "server/pump/pose_of.h"

namespace palpate {
namespace {

constexpr char kPushHand[] = "/palpate.v1.DeviceService/PushHand";

constexpr std::chrono::seconds kTickPatience{1};

constexpr double kLongestPushS = HandPush::kMostTicks / ServoLoop::kRateHz;

void CheckHand(std::uint32_t hand) {
  if (hand == 0) return;
  throw Error(ErrorKind::kInvalidArgument, "the daemon has one hand, 0");
}

bool Act(const ForceStatus& forces) {
  return forces.state == ForceState::kRampIn || forces.state == ForceState::kOn;
}

bool ForcesAreKnown(const DeviceDescription& spec) {
  return spec.verification_level == VerificationLevel::kForceVerified || !IsHardware(spec);
}

// If several devices are of one kind, the daemon uses the one that works.
int IndexInUse(const std::vector<ListedDevice>& devices, const std::string& kind) {
  const auto is_ours = [&](const ListedDevice& d) { return d.kind == kind; };
  const bool alone = std::count_if(devices.begin(), devices.end(), is_ours) == 1;
  for (std::size_t n = 0; n < devices.size(); ++n) {
    if (is_ours(devices[n]) && (alone || devices[n].problem.empty())) return static_cast<int>(n);
  }
  return -1;
}

[[noreturn]] void RefuseWhileItMoves() {
  throw Error(ErrorKind::kFailedPrecondition,
              "the device is about to move its arm by itself, or moves it: keep clear of it, and "
              "enable forces when it rests");
}

Error NoTick(ForceCommand command, bool holds) {
  return {ErrorKind::kUnavailable, "the haptic loop did not tick within 1 s: the command to " +
                                       std::string(NameOf(command)) + " forces " +
                                       (holds ? "holds from its next tick on" : "was taken back") +
                                       "; look at palpated's log, or end it"};
}

template <typename Response>
void Answer(const ForceTick& forces, Response& response, bool replay = false) {
  *response.mutable_forces() = ToProto(ForcesOf(forces.forces, replay));
  response.set_applied_tick(forces.since_tick);
}

// Checks every millisecond for the tick that knows of the stop. Runs on gRPC's own threads and does
// not hold any of them while it waits.
class StopAnswer final : public grpc::ServerUnaryReactor {
 public:
  StopAnswer(Admission admission, const ForceWatch& forces, std::uint64_t tick,
             v1::StopForcesResponse& response)
      : admission_(std::move(admission)), forces_(forces), tick_(tick), response_(response) {
    Look();
  }

  void OnDone() override { delete this; }

 private:
  void Look() {
    // Read before the check, so that a thread that was kept off its core checks once more.
    const bool is_last = std::chrono::steady_clock::now() > end_;
    const auto forces = forces_.newest();
    if (forces && (forces->ended || forces->tick >= tick_)) {
      Answer(*forces, response_);
      End(grpc::Status::OK);
    } else if (is_last) {
      End(ToStatus(NoTick(ForceCommand::kStop, /*holds=*/true)));
    } else {
      // A new alarm is needed, because this may be the callback of the last one.
      alarm_ = std::make_unique<grpc::Alarm>();
      alarm_->Set(gpr_time_add(gpr_now(GPR_CLOCK_MONOTONIC), gpr_time_from_millis(1, GPR_TIMESPAN)),
                  [this](bool) { Look(); });
    }
  }

  void End(const grpc::Status& status) {
    Finish(admission_.Answered(status, response_.ByteSizeLong()));
  }

  Admission admission_;
  const ForceWatch& forces_;
  const std::uint64_t tick_;
  v1::StopForcesResponse& response_;
  const std::chrono::steady_clock::time_point end_ =
      std::chrono::steady_clock::now() + kTickPatience;
  std::unique_ptr<grpc::Alarm> alarm_;
};

}  // namespace

Reply* DeviceService::GetDevice(CallContext* context, const v1::GetDeviceRequest* request,
                                v1::GetDeviceResponse* response) {
  return calls_.Answer(context, "/palpate.v1.DeviceService/GetDevice", *request, *response,
                       [=, this](const Admission& admission) {
                         CheckHand(request->hand());
                         const HandsState now = Hands();
                         const Hand& hand = now.hands.front();
                         *response = ToProto(GetDeviceResponse{
                             .device = hand.device,
                             .servo = now.servo,
                             .health = hand.health,
                             .forces = hand.forces,
                             .caller = {admission.caller().name, admission.caller().role},
                             .forces_set_by = hand.forces_set_by,
                             .hand_led_by = hand.led_by});
                         // Before the first tick.
                         if (hand.forces.state == ForceState::kUnknown) response->clear_forces();
                       });
}

HandsState DeviceService::Hands() const {
  stop_door_.TellStops();  // so that who has stopped is known
  Hand hand = {.device = device_.spec(), .health = device_.health()};
  // None before the first tick.
  if (const auto forces = forces_.newest()) {
    hand.forces = ForcesOf(forces->forces, session_.forces_off());
    hand.forces_set_by = SetBy(*forces);
  }
  if (hand_) hand.led_by = hand_->led_by();
  return {.hands = {std::move(hand)}, .servo = Servo()};
}

Reply* DeviceService::ListDevices(CallContext* context, const v1::ListDevicesRequest* request,
                                  v1::ListDevicesResponse* response) {
  return calls_.Answer(context, "/palpate.v1.DeviceService/ListDevices", *request, *response,
                       [=, this](const Admission&) {
                         std::vector<ListedDevice> devices = list_();
                         const int in_use = IndexInUse(devices, device_.spec().kind);
                         for (ListedDevice& device : devices) {
                           device.in_use = &device - devices.data() == in_use;
                           *response->add_devices() = ToProto(device);
                         }
                       });
}

Reply* DeviceService::EnableForces(CallContext* context, const v1::EnableForcesRequest* request,
                                   v1::EnableForcesResponse* response) {
  return calls_.Answer(context, "/palpate.v1.DeviceService/EnableForces", *request, *response,
                       [=, this](const Admission& by) {
                         CheckHand(request->hand());
                         CheckName(request->device());
                         if (device_.moves_by_itself()) RefuseWhileItMoves();
                         const ForceTick forces = Command(ForceCommand::kEnable);
                         CheckEnabled(forces.forces);
                         // A calibration may have been asked for meanwhile; it looks after this.
                         if (device_.moves_by_itself()) {
                           Command(ForceCommand::kDisable);
                           RefuseWhileItMoves();
                         }
                         Note(ForceCommand::kEnable, by);
                         Answer(forces, *response, session_.forces_off());
                       });
}

Reply* DeviceService::DisableForces(CallContext* context, const v1::DisableForcesRequest* request,
                                    v1::DisableForcesResponse* response) {
  return calls_.Answer(context, "/palpate.v1.DeviceService/DisableForces", *request, *response,
                       [=, this](const Admission& by) {
                         if (request->has_hand()) CheckHand(request->hand());
                         device_.StopMoving();
                         const ForceTick forces = Command(ForceCommand::kDisable);
                         Note(ForceCommand::kDisable, by);
                         Answer(forces, *response);
                       });
}

Reply* DeviceService::StopForces(CallContext* context, const v1::StopForcesRequest*,
                                 v1::StopForcesResponse* response) {
  constexpr char kMethod[] = "/palpate.v1.DeviceService/StopForces";
  Access& access = calls_.access();
  // First of all: what follows may wait for a lock, for memory or for the log.
  if (access.May(*context, kMethod)) {
    servo_.forces().Set(ForceCommand::kStop);
    device_.StopMoving();
  }
  Admission admission = access.Admit(context, kMethod);
  if (!admission.ok()) {
    // DefaultReactor is called once: a second call would return another reactor.
    Reply* const refused = context->DefaultReactor();
    refused->Finish(admission.status());
    return refused;
  }
  Note(ForceCommand::kStop, admission);
  return new StopAnswer(std::move(admission), forces_, servo_.FirstTickThatKnows(), *response);
}

Reply* DeviceService::PushHand(CallContext* context, const v1::PushHandRequest* request,
                               v1::PushHandResponse* response) {
  return calls_.Answer(context, kPushHand, *request, *response, [=, this](const Admission& by) {
    CheckHand(request->hand());
    const Vec3 force_D_n = FromProto(request->force_n());
    if (!force_D_n.allFinite() || !(force_D_n.stableNorm() <= HandPush::kMostN)) {
      throw Error(ErrorKind::kInvalidArgument, "force_n must be at most 0.5 N long");
    }
    const double seconds = request->seconds();
    if (!(seconds > 0.0) || !(seconds <= kLongestPushS)) {
      throw Error(ErrorKind::kInvalidArgument, "seconds must be above 0 and at most 5");
    }
    const auto refuse_unless_they_act = [&](const std::optional<ForceTick>& forces) {
      ForceStatus now;
      if (forces) now = ForcesOf(forces->forces, session_.forces_off());
      if (forces && Act(now)) return;
      Push(Vec3::Zero(), 0, {});
      throw Error(ErrorKind::kFailedPrecondition,
                  "the forces do not act: " +
                      (forces ? InWords(now.reason) : "the haptic loop does not tick"));
    };
    if (!(device_.spec().max_force_n > 0.0)) {
      throw Error(ErrorKind::kFailedPrecondition,
                  "the daemon cannot drive the motors of `" + device_.spec().kind +
                      "`: their figures are missing, or not public");
    }
    const int ticks = std::max(1, static_cast<int>(seconds * ServoLoop::kRateHz));
    if (const int left = servo_.pushes().ticks_left(); ticks > left) {
      throw Error(ErrorKind::kTooLarge,
                  fmt::format("pushes may take 5 s of any 10 s, and {:.2f} s are left: wait for "
                              "up to 10 s",
                              left / ServoLoop::kRateHz));
    }
    refuse_unless_they_act(forces_.newest());
    Push(force_D_n, ticks, by.credentials());
    const std::uint64_t tick = servo_.FirstTickThatKnows();
    refuse_unless_they_act(forces_.WaitForTick(tick, kTickPatience));
    LogOfClient(LogLevel::kInfo, "forces, " + by.caller().name,
                "forces: a push of ({:.2f}, {:.2f}, {:.2f}) N for {:g} s, by {}", force_D_n.x(),
                force_D_n.y(), force_D_n.z(), seconds, by.Who());
    response->set_applied_tick(tick);
  });
}

Reply* DeviceService::CalibrateDevice(CallContext* context,
                                      const v1::CalibrateDeviceRequest* request,
                                      v1::CalibrateDeviceResponse* response) {
  return calls_.Answer(context, "/palpate.v1.DeviceService/CalibrateDevice", *request, *response,
                       [=, this](const Admission& by) {
                         CheckHand(request->hand());
                         const DeviceHealth health = device_.health();
                         if (health.connection != DeviceConnection::kStreaming) {
                           throw Error(ErrorKind::kFailedPrecondition,
                                       "the device `" + device_.spec().kind +
                                           "` is not connected, so it cannot be calibrated: " +
                                           (health.problem.empty() ? "it is being set up, try again"
                                                                   : health.problem));
                         }
                         CheckForcesAreOff();
                         CheckCalibrated(request->device());
                         device_.Calibrate();
                         // Forces may have been enabled meanwhile.
                         try {
                           CheckForcesAreOff();
                         } catch (const Error&) {
                           device_.StopMoving();
                           throw;
                         }
                         LogOfClient(LogLevel::kInfo, "calibrate, " + by.caller().name,
                                     "the device is to be calibrated, by {}", by.Who());
                         *response->mutable_health() = ToProto(device_.health());
                       });
}

LeadHandReactor* DeviceService::LeadHand(CallContext* context) {
  Admission admission = calls_.access().Admit(context, "/palpate.v1.DeviceService/LeadHand");
  using Refused = RefusedStream<v1::LeadHandRequest, v1::LeadHandResponse>;
  if (!admission.ok()) return new Refused(std::move(admission));
  if (!hand_) {
    return new Refused(std::move(admission),
                       {grpc::StatusCode::FAILED_PRECONDITION,
                        "only the simulated hand can be led, and the daemon's device is `" +
                            device_.spec().kind + "`: set [device] kind = \"simulated\""});
  }
  const std::uint32_t buttons = (1U << device_.spec().button_count) - 1;
  return LeadHandWith({*hand_, servo_, forces_, buttons}, std::move(admission));
}

ServoDescription DeviceService::Servo() const {
  return {.rate_hz = ServoLoop::kRateHz,
          .realtime_scheduling = servo_.grant().fifo,
          .memory_locked = servo_.grant().memory_locked,
          .warnings = servo_.grant().warnings,
          .ticks = servo_.ticks(),
          .missed_ticks = servo_.missed_ticks(),
          .scenes_applied = inbox_.announced(),
          .version = PALPATE_VERSION,
          .faulty_ticks = servo_.faulty_ticks(),
          .page_faults = servo_.page_faults(),
          .lost_samples = servo_.lost_samples()};
}

void DeviceService::CheckName(const std::string& name) const {
  const DeviceDescription& spec = device_.spec();
  // The client may send a name of any length and content, so the message does not repeat it.
  if (!name.empty() && name != spec.kind) {
    throw Error(ErrorKind::kInvalidArgument, "the daemon's device is `" + spec.kind +
                                                 "`, not the one named: 'palpate device " +
                                                 "enable " + spec.kind + "' enables its forces");
  }
  if (name.empty() && !ForcesAreKnown(spec)) {
    throw Error(ErrorKind::kInvalidArgument,
                "the forces of `" + spec.kind +
                    "` were never verified on hardware and may push anywhere: to accept this, "
                    "enable them by its name, with 'palpate device enable " +
                    spec.kind + "'");
  }
}

void DeviceService::CheckCalibrated(const std::string& name) const {
  const DeviceDescription& spec = device_.spec();
  if (name.empty() ? !spec.calibration_moves_arm : name == spec.kind) return;
  throw Error(ErrorKind::kInvalidArgument,
              "the daemon's device is `" + spec.kind +
                  (spec.calibration_moves_arm
                       ? "`, whose arm moves by itself: keep clear of it, and give its name, with "
                       : "`, not the one named: give its name, with ") +
                  "'palpate device calibrate " + spec.kind + "'");
}

// Gives the command and returns a tick that certainly knows it. Another command may have come in
// between: the tick tells which command holds.
ForceTick DeviceService::Command(ForceCommand command) {
  servo_.forces().Set(command);
  if (const auto forces = forces_.WaitForTick(servo_.FirstTickThatKnows(), kTickPatience)) {
    return *forces;
  }
  // The client that asked for forces may be gone when they would come on.
  const bool holds = command != ForceCommand::kEnable;
  if (!holds) servo_.forces().Withdraw(command);
  throw NoTick(command, holds);
}

void DeviceService::Push(const Vec3& force_D_n, int ticks, const Credentials& by) {
  const std::lock_guard lock(mutex_);
  servo_.pushes().Push(force_D_n, ticks);
  pushed_by_ = by;
  pushes_until_ =
      std::chrono::steady_clock::now() + kTickPatience + std::chrono::milliseconds(ticks);
}

// A push outlives its call.
void DeviceService::EndRevokedPush() {
  Credentials by;
  {
    const std::lock_guard lock(mutex_);
    if (std::chrono::steady_clock::now() > pushes_until_) return;
    by = pushed_by_;
  }
  if (calls_.access().MayStill(by, kPushHand)) return;
  const std::lock_guard lock(mutex_);
  if (pushed_by_ == by) servo_.pushes().Push(Vec3::Zero(), 0);
}

void DeviceService::Note(ForceCommand command, const Admission& by) {
  Note(command, by.caller().name, by.Who());
}

// Whoever may open the stop's socket may open the other one.
void DeviceService::NoteLocalStop(const StopCaller& by) {
  std::string said = by.by_door.data();
  std::ranges::replace_if(
      said, [](char c) { return c < ' ' || c > '~'; }, '?');
  if (const std::size_t slash = said.find('/'); slash != said.npos) {
    const Identity caller{said.substr(slash + 1)};
    return Note(ForceCommand::kStop, caller.name, WhoInWords(caller, said.substr(0, slash)));
  }
  Note(ForceCommand::kStop, "stop socket", "local socket",
       fmt::format(", user {}, process {}", by.user, by.process));
}

void DeviceService::Note(ForceCommand command, const std::string& whose, const std::string& who,
                         const std::string& more) {
  const bool is_stop = command == ForceCommand::kStop;
  {
    const std::lock_guard lock(mutex_);
    (is_stop ? stopped_by_ : command == ForceCommand::kEnable ? enabled_by_ : disabled_by_) = who;
  }
  calls_.access().Changed("forces", who);
  // No other lines of the client may hide these.
  LogOfClient(is_stop ? LogLevel::kWarning : LogLevel::kInfo, "forces, " + whose,
              "forces: {}, by {}{}", is_stop ? "emergency stop" : NameOf(command), who, more);
}

std::string DeviceService::SetBy(const ForceTick& forces) const {
  const std::lock_guard lock(mutex_);
  switch (forces.forces.state) {
    case ForceState::kOn:
    case ForceState::kRampIn:
    case ForceState::kHeld:
      return enabled_by_;
    case ForceState::kOff:
      return forces.forces.reason == ForceReason::kOperator ? disabled_by_ : "";
    case ForceState::kStopped:
      return forces.forces.reason == ForceReason::kStopCall ? stopped_by_ : "";
    case ForceState::kUnknown:
    case ForceState::kFault:
      break;
  }
  return "";
}

// A new zero makes positions jump, and the forces with them.
void DeviceService::CheckForcesAreOff() const {
  const std::optional<ForceTick> forces = forces_.newest();
  if (!forces || !IsHardware(device_.spec())) return;
  // While an arm moves by itself, nothing may be left that ends in forces.
  const bool must_be_off = device_.spec().calibration_moves_arm;
  if (must_be_off ? forces->forces.state == ForceState::kOff : !Act(forces->forces)) return;
  throw Error(ErrorKind::kFailedPrecondition,
              "forces are not off: disable them first, with 'palpate device disable'");
}

void DeviceService::CheckEnabled(const ForceStatus& forces) const {
  if (Act(forces) || forces.state == ForceState::kHeld) return;
  const std::string problem =
      forces.reason == ForceReason::kDevice ? device_.health().problem : std::string();
  const std::string state = forces.state == ForceState::kFault ? "a fault"
                            : forces.state == ForceState::kOff ? "disabled at the same time"
                                                               : "stopped";
  throw Error(
      ErrorKind::kFailedPrecondition,
      "forces stay off (" + state + "): " + (problem.empty() ? InWords(forces.reason) : problem));
}

}  // namespace palpate
