#include "server/device/forcedimension/forcedimension_bus.h"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "common/error/error.h"
#include "server/device/stream/vendor_library.h"
#include "server/realtime/thread_setup.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

// An opened device of Force Dimension's library. forcedimension_bus.h says what it does.
//
// Threads, errors: as StreamSession.
class FdSession final : public StreamSession {
 public:
  // Borrows all, and owns the opened ID.
  FdSession(const FdLibrary& library, char id, const FdModel& model,
            const ForceDimensionOptions& options, ForceDimensionBus::Exchange& exchange);
  ~FdSession() override;

  void SetUp(const std::atomic<bool>& stop) override;
  std::string place() const override { return ""; }
  std::string identity() const override { return identity_; }
  StreamReceived Wait(std::chrono::microseconds longest, DeviceState& state) override;
  bool TrySend(const DeviceCommand& command) override;
  std::uint64_t transfer_errors() const override { return errors_; }
  bool LetGo() noexcept override;

 private:
  FdAbilities Abilities() const;
  // Returns whether the device will brake by itself.
  bool SetWatchdog();
  bool HasWatchdog();
  void TakeReading(StreamReceived& received, DeviceState& state);
  using Status = std::array<int, fd::kStatusRoom>;
  // Returns false if the device does not tell it. Throws after some times in a row.
  bool ReadStatus(Status& status);
  // Throws what ended the device's forces, if its motors should be on.
  void CheckMotors(const Status& status);
  void Watch(StreamReceived& received);
  void WatchMotors(const Status& status, StreamReceived& received);
  const char* HintOf(const Status& status) const;
  // After the warning, unless something speaks against it.
  void PrepareCalibration(const Status& status, StreamReceived& received);
  void Calibrate(StreamReceived& received);
  void Switch(bool on);
  int SetWrench(const Wrench& wrench_M);
  // Returns whether a call went well. Throws if the device is gone, or after some errors in a row.
  bool Check(int result, const char* call, int& errors_in_a_row);

  const FdLibrary& library_;
  const fd::Functions& fd_;
  const char id_;
  const FdModel& model_;
  const ForceDimensionOptions& options_;
  ForceDimensionBus::Exchange& exchange_;

  std::string identity_;
  Vec3 centre_m_ = Vec3::Zero();
  bool brakes_itself_ = false;
  bool is_open_ = true;
  TickTimer timer_;
  std::uint64_t missed_ = 0;  // ticks, as told so far
  std::int64_t next_watch_ns_ = 0;
  std::uint64_t errors_ = 0;
  int bad_readings_ = 0, bad_forces_ = 0, bad_statuses_ = 0, bad_switches_ = 0;  // in a row
  bool knows_calibration_ = false;
  bool is_calibrated_ = false;
  bool wants_motors_ = false;  // by the last command
  bool motors_on_ = false;
  bool has_been_on_ = false;  // by the device's status, since they were switched on
  std::int64_t switched_ns_ = 0, commanded_ns_ = 0;
  std::int64_t calibrates_at_ns_ = 0;  // 0: it does not
  std::int64_t saturated_since_ns_ = 0;
  std::int64_t saturation_told_ns_ = 0;
};

constexpr std::int64_t kMsNs = 1'000'000;
constexpr std::chrono::nanoseconds kPeriod{1'000'000'000 / ForceDimensionBus::kRateHz};
constexpr std::int64_t kWatchNs = 50 * kMsNs;
// LimitRTTIME= ends a thread that does not sleep: a library that is late may be busy all the time.
constexpr std::chrono::microseconds kLateSleep{50};
constexpr std::chrono::milliseconds kStopLook{10};
constexpr std::int64_t kWatchdogStepNs = 125'000;
constexpr auto kWatchdogSteps =
    static_cast<unsigned char>(ForceDimensionBus::kWatchdogMs * 1e6 / kWatchdogStepNs);
constexpr int kLostCalls = 10;
// The device may take this long until its status says that its motors are on.
constexpr std::int64_t kMotorsOnNs = 100 * kMsNs;
constexpr std::int64_t kSaturatedNs = 100 * kMsNs, kTellAgainNs = 10'000 * kMsNs;
constexpr int kLastZeros = 3;
constexpr double kMotorTorqueNm = 0.2;  // of sigma.7 and lambda.7, by CHAI3D's driver

constexpr const char* kNoPower = "no power: plug in the device's power supply and switch it on";
constexpr const char* kNoWatchdog =
    "no forces: this device does not brake by itself when palpated is killed or frozen (firmware "
    "before 3.0); to have forces all the same, set [device] forcedimension_without_watchdog = true";
constexpr const char* kNoStatus = "the device does not tell its state";
constexpr const char* kWillMove = "its arm moves by itself in 3 s: keep clear of it";
constexpr const char* kCalibrates = "being calibrated: the arm moves by itself, keep clear of it";

const char* WhyOff(int cause) {
  switch (cause) {
    case fd::kOffByButton:
      return "its force button was pressed";
    case fd::kOffByVelocity:
      return "it moved faster than the device allows";
    case fd::kOffByWatchdog:
      return "its watchdog braked it, as no command came in time";
    case fd::kOffByDeadMan:
      return "no hand was on its handle";
    case fd::kOffByUsb:
      return "the USB connection failed: another cable, another port";
    default:
      return "its motors are not on: press its force button, if it has one, and look at its lights";
  }
}

std::string EndedBy(int cause) {
  return fmt::format("the device ended its forces: {}", WhyOff(cause));
}

FdSession::FdSession(const FdLibrary& library, char id, const FdModel& model,
                     const ForceDimensionOptions& options, ForceDimensionBus::Exchange& exchange)
    : library_(library),
      fd_(library.functions()),
      id_(id),
      model_(model),
      options_(options),
      exchange_(exchange),
      timer_(kPeriod, std::chrono::nanoseconds(0)) {}

FdSession::~FdSession() {
  exchange_.calibrates = false;
  if (is_open_) fd_.close(id_);
}

FdAbilities FdSession::Abilities() const {
  const char* name = fd_.system_name(id_);
  return {.system_name = name != nullptr ? name : "",
          .has_wrist = fd_.has_wrist(id_),
          .has_torque = fd_.has_active_wrist(id_),
          .has_gripper = fd_.has_gripper(id_),
          .is_left_handed = fd_.is_left_handed(id_)};
}

void FdSession::SetUp(const std::atomic<bool>& /*stop*/) {
  const OrdinaryScheduling ordinary;
  const KeptSignals kept;
  exchange_.hint = kNoStatus;
  const FdAbilities its = Abilities();
  const FdModel* const known = FdModelWith(its);
  if (known == nullptr && its.system_name.empty()) {
    throw BusError(BusFault::kBroken, "the device does not say who it is: " + library_.LastError());
  }
  if (known != &model_) {
    throw BusError(BusFault::kUnsuitable,
                   fmt::format("the device is \"{}\", and [device] forcedimension_model is \"{}\": "
                               "set it to {}, and start palpated again",
                               its.system_name, model_.name,
                               known != nullptr ? fmt::format("\"{}\"", known->name)
                                                : "the one of " + FdModelNames() + " that it is"));
  }
  centre_m_ = FdCentre(model_, its.is_left_handed);
  Switch(false);
  fd_.set_brakes(1, id_);
  const bool holds_weight = fd_.set_gravity_compensation(1, id_) >= 0;
  // Whether this limit includes the arm's weight is not written. A lower one might drop the arm.
  fd_.set_max_force(model_.motor_force_n, id_);
  if (model_.has_torque) fd_.set_max_torque(kMotorTorqueNm, id_);
  if (model_.has_gripper) fd_.set_max_gripper_force(0.0, id_);
  if (options_.gripper_button) fd_.emulate_button(1, id_);
  brakes_itself_ = SetWatchdog();
  unsigned short serial = 0;  // NOLINT(google-runtime-int): as in C
  fd_.serial_number(&serial, id_);
  double firmware = 0.0;
  fd_.firmware_version(&firmware, id_);
  knows_calibration_ = fd_.knows_calibration(id_);
  identity_ = fmt::format(
      "{}{}, serial number {}, firmware {:g}, SDK {}; gravity compensation {}, {}", its.system_name,
      its.is_left_handed ? " (left-handed)" : "", serial, firmware, library_.version(),
      holds_weight ? "on" : "not possible",
      brakes_itself_
          ? fmt::format("brakes {:g} ms after the last command", ForceDimensionBus::kWatchdogMs)
          : "does not brake by itself");
}

bool FdSession::SetWatchdog() {
  fd_.enable_expert_mode();
  fd_.set_watchdog(kWatchdogSteps, id_);
  fd_.disable_expert_mode();
  return HasWatchdog();
}

bool FdSession::HasWatchdog() {
  unsigned char steps = 0;
  return fd_.get_watchdog(&steps, id_) >= 0 && steps == kWatchdogSteps;
}

StreamReceived FdSession::Wait(std::chrono::microseconds /*longest*/, DeviceState& state) {
  StreamReceived received;
  const TickTime tick = timer_.WaitForNext();
  received.lost_readings =
      static_cast<std::uint32_t>(tick.missed - std::exchange(missed_, tick.missed));
  if (received.lost_readings > 0) std::this_thread::sleep_for(kLateSleep);
  // Also in each tick until the device says that its motors are on. From then on, "off" means that
  // the device has ended its forces.
  if (tick.started_ns >= next_watch_ns_ || (motors_on_ && !has_been_on_)) Watch(received);
  TakeReading(received, state);
  return received;
}

void FdSession::TakeReading(StreamReceived& received, DeviceState& state) {
  Vec3 p_m = Vec3::Zero();
  double rows[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const int result = model_.has_wrist
                         ? fd_.position_and_frame(&p_m.x(), &p_m.y(), &p_m.z(), rows, id_)
                         : fd_.position(&p_m.x(), &p_m.y(), &p_m.z(), id_);
  if (!Check(result, "dhdGetPosition", bad_readings_) || result == fd::kTimeGuard) return;
  const Eigen::Matrix3d handle =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(&rows[0][0]);
  if (!p_m.allFinite() || !IsRotation(handle)) {
    ++received.corrupt_frames;
    return;
  }
  state.buttons = fd_.buttons(id_) & 1u;  // the first; what others are is not written
  state.p_MHip_mm = 1000.0 * FdToM(p_m - centre_m_);
  state.R_MS = FdHandleToM(handle);
  state.docked = false;
  state.calibrated = is_calibrated_;
  received.time_ns = MonotonicNowNs();
  received.has_reading = true;
  received.readings = 1;
}

bool FdSession::ReadStatus(Status& status) {
  status.fill(-1);  // what an older library does not write
  return Check(fd_.status(status.data(), id_), "dhdGetStatus", bad_statuses_);
}

void FdSession::Watch(StreamReceived& received) {
  next_watch_ns_ = MonotonicNowNs() + kWatchNs;
  Status status;
  if (!ReadStatus(status)) {
    is_calibrated_ = false;
    exchange_.hint = kNoStatus;
    return;
  }
  WatchMotors(status, received);
  const char* const hint = HintOf(status);
  const bool was_calibrated = std::exchange(is_calibrated_, *hint == '\0');
  // A device that had no power, or was reset, has forgotten its settings.
  if (!was_calibrated && is_calibrated_ && brakes_itself_ && !HasWatchdog()) {
    throw BusError(BusFault::kBroken, "the device has lost its settings");
  }
  const char* const shown = exchange_.calibrates ? kWillMove : hint;
  const char* const old = exchange_.hint.exchange(shown);
  if (shown == hint && *hint != '\0' && *old != '\0' && old != hint) received.warning = hint;
  if (exchange_.calibrates) PrepareCalibration(status, received);
}

void FdSession::PrepareCalibration(const Status& status, StreamReceived& received) {
  const std::int64_t now_ns = MonotonicNowNs();
  const char* why_not = nullptr;
  if (exchange_.is_stopped()) why_not = "it was stopped";
  if (wants_motors_) why_not = "its forces are on; disable them first";
  if (!brakes_itself_ && !options_.without_watchdog) why_not = kNoWatchdog;
  if (status[fd::kStatusPower] == 0) why_not = kNoPower;
  if (why_not != nullptr) {
    received.warning = fmt::format("its arm does not move: {}", why_not);
  } else if (calibrates_at_ns_ == 0) {
    calibrates_at_ns_ =
        now_ns + std::chrono::nanoseconds(ForceDimensionBus::kCalibrationWarning).count();
    received.warning = kWillMove;
    return;
  } else if (now_ns < calibrates_at_ns_) {
    return;
  } else {
    Calibrate(received);
  }
  calibrates_at_ns_ = 0;
  exchange_.calibrates = false;
}

void FdSession::WatchMotors(const Status& status, StreamReceived& received) {
  const std::int64_t now_ns = MonotonicNowNs();
  if (motors_on_) {
    CheckMotors(status);
  } else if (status[fd::kStatusForce] == 1 && now_ns - switched_ns_ > kMotorsOnNs) {
    received.warning = "its motors were on by themselves; they are switched off";
    Switch(false);
  }
  if (saturated_since_ns_ != 0 && now_ns - saturated_since_ns_ > kSaturatedNs &&
      now_ns > saturation_told_ns_) {
    saturation_told_ns_ = now_ns + kTellAgainNs;
    received.warning = "its motors cannot give the whole force at this place; it is scaled down";
  }
}

const char* FdSession::HintOf(const Status& status) const {
  if (status[fd::kStatusPower] == 0) return kNoPower;
  const bool is_known = !knows_calibration_ || fd_.is_calibrated(id_);
  if (status[fd::kStatusReset] == 1 || !is_known) return model_.calibration_hint;
  return brakes_itself_ || options_.without_watchdog ? "" : kNoWatchdog;
}

void FdSession::CheckMotors(const Status& status) {
  if (status[fd::kStatusPower] == 0) throw BusError(BusFault::kBroken, kNoPower);
  const bool is_off = status[fd::kStatusForce] == 0;
  has_been_on_ = has_been_on_ || !is_off;
  const bool is_due = has_been_on_ || MonotonicNowNs() - switched_ns_ > kMotorsOnNs;
  if (is_off && is_due) {
    throw BusError(BusFault::kBroken, EndedBy(status[fd::kStatusForceOffCause]));
  }
}

void FdSession::Calibrate(StreamReceived& received) {
  exchange_.hint = kCalibrates;
  const OrdinaryScheduling ordinary;
  const KeptSignals kept;
  // The library takes calls from any thread: this one ends the motion when somebody wants that. The
  // servo gets no readings meanwhile, so the device's button ends it here.
  std::jthread stopper([&](const std::stop_token& is_over) {
    while (!is_over.stop_requested()) {
      if ((fd_.buttons(id_) & 1u) != 0) ++exchange_.stops;
      if (exchange_.is_stopped()) fd_.enable_force(0, id_);
      std::this_thread::sleep_for(kStopLook);
    }
  });
  const bool is_done = fd_.calibrate(id_) >= 0;
  stopper.request_stop();
  stopper.join();
  const std::string error = is_done ? "" : library_.LastError();
  fd_.end_calibration(true, id_);
  Switch(false);  // the library may have left them on
  received.warning = is_done ? "it has calibrated itself"
                             : "it could not calibrate itself: " +
                                   (exchange_.is_stopped() ? "it was stopped" : error);
  timer_ = TickTimer(kPeriod, std::chrono::nanoseconds(0));
  missed_ = 0;
  received.restarted = true;
}

bool FdSession::TrySend(const DeviceCommand& command) {
  wants_motors_ = command.motors_on;
  const std::int64_t now_ns = MonotonicNowNs();
  const bool has_braked =
      motors_on_ && brakes_itself_ && now_ns - commanded_ns_ > kWatchdogSteps * kWatchdogStepNs;
  if (has_braked) throw BusError(BusFault::kBroken, EndedBy(fd::kOffByWatchdog));
  const bool on = command.motors_on && is_calibrated_;
  if (on != motors_on_) Switch(on);
  if (!motors_on_) return true;  // braked: there is nothing to send
  const int result = SetWrench(on ? command.wrench_M : Wrench{});
  if (!Check(result, "dhdSetForceAndTorqueAndGripperForce", bad_forces_)) return true;
  if (result != fd::kSaturated) {
    saturated_since_ns_ = 0;
  } else if (saturated_since_ns_ == 0) {
    saturated_since_ns_ = MonotonicNowNs();
  }
  return true;
}

// Motors that stay on are a fault. That the device itself has ended its forces is not lost.
void FdSession::Switch(bool on) {
  Status status;
  if (motors_on_) SetWrench({});
  if (motors_on_ && ReadStatus(status)) CheckMotors(status);
  if (!Check(fd_.enable_force(on ? 1 : 0, id_), "dhdEnableForce", bad_switches_)) {
    if (on) return;
    throw BusError(BusFault::kBroken, "its motors do not go off: " + library_.LastError());
  }
  motors_on_ = on;
  switched_ns_ = commanded_ns_ = MonotonicNowNs();
  saturated_since_ns_ = 0;
  has_been_on_ = false;
}

int FdSession::SetWrench(const Wrench& wrench_M) {
  commanded_ns_ = MonotonicNowNs();
  const Vec3 force_n = FdFromM(wrench_M.force_n);
  const Vec3 torque_n_m = 0.001 * FdFromM(wrench_M.torque_n_mm);
  return fd_.set_force(force_n.x(), force_n.y(), force_n.z(), torque_n_m.x(), torque_n_m.y(),
                       torque_n_m.z(), 0.0, id_);
}

bool FdSession::Check(int result, const char* call, int& errors_in_a_row) {
  if (result >= 0) {
    errors_in_a_row = 0;
    return true;
  }
  ++errors_;
  const int error = fd_.last_error();
  if (error == fd::kErrorNoDevice) throw BusError(BusFault::kAbsent, "the device is gone");
  if (++errors_in_a_row < kLostCalls) return false;
  const std::string text = fmt::format("{} fails: {}", call, library_.LastError());
  // The device may say by its status why it takes no force.
  Status status;
  if (&errors_in_a_row == &bad_forces_ && ReadStatus(status)) CheckMotors(status);
  throw BusError(BusFault::kBroken, text);
}

bool FdSession::LetGo() noexcept {
  const OrdinaryScheduling ordinary;
  for (int n = 0; motors_on_ && n < kLastZeros; ++n) SetWrench({});
  bool is_off = false;
  for (int n = 0; !is_off && n < kLastZeros; ++n) is_off = fd_.enable_force(0, id_) >= 0;
  fd_.close(id_);
  is_open_ = false;
  return is_off || brakes_itself_;
}

constexpr const char* kVendor = "1451";

template <class Value>
Value LineOf(const std::filesystem::path& file) {
  Value value{};
  std::ifstream(file) >> value;
  return value;
}

}  // namespace

FdOnUsb FindFdOnUsb(const std::filesystem::path& root) {
  FdOnUsb found;
  std::error_code error;
  for (const auto& entry :
       std::filesystem::directory_iterator(root / "sys/bus/usb/devices", error)) {
    const std::filesystem::path& device = entry.path();
    if (LineOf<std::string>(device / "idVendor") != kVendor) continue;
    ++found.count;
    const std::string node = fmt::format("dev/bus/usb/{:03}/{:03}", LineOf<int>(device / "busnum"),
                                         LineOf<int>(device / "devnum"));
    found.may_open = found.may_open && access((root / node).c_str(), R_OK | W_OK) == 0;
  }
  return found;
}

ForceDimensionBus::ForceDimensionBus(ForceDimensionOptions options)
    : options_(std::move(options)), model_(FdModelOf(options_.model)), spec_(FdSpec(model_)) {
  if (!options_.gripper_button || model_.has_gripper) return;
  throw Error(
      ErrorKind::kInvalidArgument,
      fmt::format("[device] forcedimension_gripper_button: an {} has no gripper", model_.name));
}

std::unique_ptr<StreamSession> ForceDimensionBus::Open(const std::atomic<bool>& /*stop*/) {
  const OrdinaryScheduling ordinary;
  const KeptSignals kept;
  if (!library_) {
    try {
      library_.emplace(options_.library);
    } catch (const Error& error) {
      throw BusError(BusFault::kUnsuitable, error.what());
    }
  }
  exchange_.calibrates = false;
  return std::make_unique<FdSession>(*library_, Choose(), model_, options_, exchange_);
}

char ForceDimensionBus::Choose() const {
  const int count = library_->functions().device_count();
  if (count <= 0) {
    const FdOnUsb found = FindFdOnUsb();
    if (!found.may_open) throw BusError(BusFault::kPermission, std::string(kPermissionHint));
    throw BusError(BusFault::kAbsent,
                   found.count == 0
                       ? "not found: plug it in and switch it on"
                       : "it is on USB, but the library does not find it: end other programs that "
                         "use it, or install a newer SDK");
  }
  std::string others, refused;
  const std::optional<char> chosen = OpenOne(count, others, refused);
  if (chosen) return *chosen;
  if (!others.empty()) {
    // Opened again and again, they would be missing to others: so not often.
    throw BusError(BusFault::kUnsuitable,
                   options_.serial.empty()
                       ? "several are plugged in, with the serial numbers " + others +
                             ": set [device] serial to one of them"
                       : "not found with serial number " + options_.serial + ": plugged in are " +
                             others +
                             (refused.empty() ? "" : ", and one that is refused: " + refused));
  }
  throw BusError(BusFault::kBusy, refused);
}

// Opening is the only way to learn a serial number.
std::optional<char> ForceDimensionBus::OpenOne(int count, std::string& others,
                                               std::string& refused) const {
  const fd::Functions& fd = library_->functions();
  const bool is_any = options_.serial.empty() && count == 1;
  for (int index = 0; index < count; ++index) {
    const int id = fd.open(static_cast<char>(index));
    if (id < 0) {
      refused = fd.last_error() == fd::kErrorInUse
                    ? "another program uses the device: end it (another palpated, the vendor's "
                      "HapticDesk)"
                    : "cannot open the device: " + library_->LastError();
      continue;
    }
    unsigned short serial = 0;  // NOLINT(google-runtime-int): as in C
    fd.serial_number(&serial, static_cast<char>(id));
    const std::string its = std::to_string(serial);
    if (is_any || options_.serial == its) return static_cast<char>(id);
    fd.close(static_cast<char>(id));
    others += (others.empty() ? "" : ", ") + its;
  }
  return std::nullopt;
}

void ForceDimensionBus::RequestCalibration() {
  if (!spec_.calibration_moves_arm) {
    throw Error(ErrorKind::kInvalidArgument,
                fmt::format("an {} is calibrated by hand: put the calibration pole into its pit",
                            model_.name));
  }
  const std::lock_guard lock(requests_);
  // Its stops stay: a second request does not undo them.
  if (exchange_.calibrates) throw Error(ErrorKind::kConflict, "it is being calibrated already");
  exchange_.stops_at_request = exchange_.stops.load();
  exchange_.calibrates = true;
}

}  // namespace palpate
