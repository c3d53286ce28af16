// DeviceService in front of a servo that runs, with devices nobody has verified.
#include "server/services/device_service.h"

#include <gtest/gtest.h>

#include <atomic>
#include <ctime>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "common/error/error.h"
#include "tests/support/device_numbers.h"
#include "tests/support/editable_session.h"
#include "tests/support/patience.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using grpc::StatusCode;

// Told by the test what to read and how it is.
class FakeDevice : public HapticDevice {
 public:
  explicit FakeDevice(VerificationLevel level) {
    spec_ = SimulatedDeviceSpec();
    spec_.kind = "fake-usb";
    spec_.verification_level = level;
  }

  const DeviceDescription& spec() const override { return spec_; }
  void Start() override {}
  void Stop() noexcept override {}
  DeviceStatus Read(DeviceState& state) noexcept override {
    state.docked = docked;
    state.buttons = buttons;
    return status;
  }
  void Write(const DeviceCommand& command, double) noexcept override {
    if (!command.wrench_M.is_zero()) ++pushes;
  }
  DeviceHealth health() const override {
    const std::lock_guard lock(mutex_);
    return health_;
  }
  void Calibrate() override {
    const std::lock_guard lock(mutex_);
    health_.calibrated = true;
  }
  void StopMoving() noexcept override { ++stops; }
  bool moves_by_itself() const noexcept override { return moves; }
  void MoveArmToCalibrate() { spec_.calibration_moves_arm = true; }
  void SetHealth(const DeviceHealth& health) {
    const std::lock_guard lock(mutex_);
    health_ = health;
  }

  std::atomic<DeviceStatus> status{DeviceStatus::kOk};
  std::atomic<bool> docked{false};
  std::atomic<std::uint32_t> buttons{0};
  std::atomic<int> pushes{0};
  std::atomic<int> stops{0};  // of what it does by itself
  std::atomic<bool> moves{false};

 private:
  DeviceDescription spec_;
  mutable std::mutex mutex_;
  DeviceHealth health_{.connection = DeviceConnection::kStreaming, .calibrated = true};
};

constexpr std::uint32_t kBothButtons = 3;

double ThreadTimeS() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

class DeviceServiceRig {
  using Stub = v1::DeviceService::Stub;

 public:
  explicit DeviceServiceRig(VerificationLevel level = VerificationLevel::kNone, bool ticks = true)
      : device(level) {
    data_.Load("builtin:sphere:16");
    data_.pump().Start();
    if (ticks) servo_.Start();
  }
  ~DeviceServiceRig() {
    servo_.Stop();
    data_.pump().Stop();
  }

  // Any of the service's calls.
  template <class Method, class Request, class Response>
  grpc::Status Call(Method method, const Request& request, Response& response) {
    grpc::ClientContext context;
    return (stub_.get()->*method)(&context, request, &response);
  }
  grpc::Status Enable(const std::string& name) {
    v1::EnableForcesRequest request;
    request.set_device(name);
    v1::EnableForcesResponse response;
    return Keep(Call(&Stub::EnableForces, request, response), response);
  }
  grpc::Status Disable() {
    v1::DisableForcesResponse response;
    return Keep(Call(&Stub::DisableForces, v1::DisableForcesRequest(), response), response);
  }
  grpc::Status Stop() {
    v1::StopForcesResponse response;
    return Keep(Call(&Stub::StopForces, v1::StopForcesRequest(), response), response);
  }
  grpc::Status List(v1::ListDevicesResponse& response) {
    return Call(&Stub::ListDevices, v1::ListDevicesRequest(), response);
  }
  grpc::Status Calibrate(v1::CalibrateDeviceResponse& response, const std::string& name = "") {
    v1::CalibrateDeviceRequest request;
    request.set_device(name);
    return Call(&Stub::CalibrateDevice, request, response);
  }
  v1::GetDeviceResponse Get() {
    v1::GetDeviceResponse response;
    EXPECT_TRUE(Call(&Stub::GetDevice, v1::GetDeviceRequest(), response).ok());
    return response;
  }
  bool Becomes(v1::ForceState state) {
    return test::Eventually([&] { return Get().forces().state() == state; });
  }

  // With another role for the socket.
  void Review(Role role) {
    access_.SetOnReview([this] { service_.EndRevokedPush(); });
    access_.SetPolicy(std::make_shared<const Policy>(PolicyOptions{.socket_role = role}));
  }

  ServoLoop& servo() { return servo_; }
  Pump& pump() { return data_.pump(); }
  Session& session() { return data_.session(); }

  FakeDevice device;
  std::vector<ListedDevice> list;
  std::optional<Error> no_list;  // thrown in its place
  std::atomic<double> list_work_s{0.0};
  std::atomic<int> lists{0};
  v1::ForceStatus answer;
  std::uint64_t applied_tick = 0;

 private:
  template <typename Response>
  grpc::Status Keep(const grpc::Status& status, const Response& response) {
    answer = response.forces();
    applied_tick = response.applied_tick();
    return status;
  }

  testing::EditableSession data_;
  const ForceWatch forces_{data_.outbox().last};
  ServoLoop servo_{
      device, data_.inbox(), data_.outbox(), {}, LimitsFor(device.spec(), kBothButtons)};
  StopDoor stop_door_{servo_, data_.outbox().last, device, 1};

  Access access_;
  Calls calls_{access_, data_.session()};
  LedHand hand_;
  DeviceService service_{
      calls_, device, &hand_, servo_, stop_door_, data_.inbox(), data_.session(), forces_, [this] {
        ++lists;
        for (const double end_s = ThreadTimeS() + list_work_s; ThreadTimeS() < end_s;) {
        }
        if (no_list) throw Error(*no_list);
        return list;
      }};

  // On the usual socket, whose clients are the admin.
  ConnectionWatch watch_{0};
  Entrance entrance_{{Transport::kSocket, Role::kAdmin}, 0, 0, watch_};
  const test::TemporaryFolder folder_;
  const std::string address_ = "unix:" + (folder_.path() / "s.sock").string();
  std::unique_ptr<grpc::Server> server_ =
      grpc::ServerBuilder()
          .AddListeningPort(address_, grpc::InsecureServerCredentials())
          .RegisterService(&service_)
          .SetContextAllocator(entrance_.MakeContexts())
          .BuildAndStart();
  std::unique_ptr<v1::DeviceService::Stub> stub_ =
      v1::DeviceService::NewStub(grpc::CreateChannel(address_, grpc::InsecureChannelCredentials()));
};

bool Has(const grpc::Status& status, const std::string& part) {
  return status.error_message().find(part) != std::string::npos;
}

TEST(DeviceService, UnverifiedForcesAreOffAndWantTheName) {
  DeviceServiceRig rig;
  ASSERT_TRUE(rig.Becomes(v1::FORCE_STATE_OFF));
  EXPECT_EQ(rig.Get().forces().reason(), v1::FORCE_REASON_OPERATOR);
  EXPECT_EQ(rig.Get().forces_set_by(), "");
  const grpc::Status nameless = rig.Enable("");
  EXPECT_EQ(nameless.error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_TRUE(Has(nameless, "fake-usb")) << nameless.error_message();
  for (const char* name : {"falcon", "fake-usb ", "FAKE-USB", "simulated"}) {
    const grpc::Status other = rig.Enable(name);
    EXPECT_EQ(other.error_code(), StatusCode::INVALID_ARGUMENT) << name;
    EXPECT_TRUE(Has(other, "fake-usb")) << other.error_message();
    EXPECT_EQ(other.error_message().find('\n'), std::string::npos);
  }
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_OFF);
  EXPECT_EQ(rig.Get().forces_set_by(), "");  // nobody has
  const std::uint64_t missed = rig.servo().missed_ticks();
  const grpc::Status enabled = rig.Enable("fake-usb");
  ASSERT_TRUE(enabled.ok()) << enabled.error_message();
  // Held where the servo missed ticks.
  EXPECT_TRUE(rig.answer.state() == v1::FORCE_STATE_RAMP_IN ||
              rig.answer.state() == v1::FORCE_STATE_ON ||
              (rig.answer.state() == v1::FORCE_STATE_HELD && rig.servo().missed_ticks() > missed));
  EXPECT_GT(rig.applied_tick, 0u);
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_ON));
}

TEST(DeviceService, EveryLevelBelowVerifiedWantsTheName) {
  using Level = VerificationLevel;
  for (const auto& [level, wants_name] : std::map<Level, bool>{{Level::kNone, true},
                                                               {Level::kEnumerated, true},
                                                               {Level::kIdentified, true},
                                                               {Level::kStateRead, true},
                                                               {Level::kForceVerified, false},
                                                               {Level::kSimulated, false}}) {
    const auto asked = [level = level](const char* name) {
      return DeviceServiceRig(level).Enable(name).error_code();
    };
    EXPECT_EQ(asked(""), wants_name ? StatusCode::INVALID_ARGUMENT : StatusCode::OK);
    EXPECT_EQ(asked("fake-usb"), StatusCode::OK);
    EXPECT_EQ(asked("falcon"), StatusCode::INVALID_ARGUMENT);
  }
}

TEST(DeviceService, StopHoldsUntilEnabled) {
  DeviceServiceRig rig;
  ASSERT_TRUE(rig.Enable("fake-usb").ok());
  EXPECT_EQ(rig.Get().forces_set_by(), "local socket");
  ASSERT_TRUE(rig.Stop().ok());
  EXPECT_EQ(rig.answer.state(), v1::FORCE_STATE_STOPPED);
  EXPECT_EQ(rig.answer.reason(), v1::FORCE_REASON_STOP_CALL);
  EXPECT_EQ(rig.Get().forces_set_by(), "local socket");
  const std::uint64_t stopped_tick = rig.applied_tick;
  // Again: the same stop, still since then.
  ASSERT_TRUE(rig.Stop().ok());
  EXPECT_EQ(rig.applied_tick, stopped_tick);
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_STOPPED);
  // A refused name leaves it.
  EXPECT_FALSE(rig.Enable("").ok());
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_STOPPED);
  EXPECT_TRUE(rig.Enable("fake-usb").ok());
  EXPECT_GT(rig.applied_tick, stopped_tick);
  ASSERT_TRUE(rig.Disable().ok());
  EXPECT_EQ(rig.answer.state(), v1::FORCE_STATE_OFF);
  EXPECT_EQ(rig.answer.reason(), v1::FORCE_REASON_OPERATOR);
  EXPECT_EQ(rig.Get().forces_set_by(), "local socket");
}

TEST(DeviceService, ADeviceThatIsGoneSaysWhatIsWrong) {
  DeviceServiceRig rig;
  rig.device.status = DeviceStatus::kFault;
  EXPECT_EQ(rig.Enable("fake-usb").error_code(), StatusCode::FAILED_PRECONDITION);
  rig.device.SetHealth(
      {.connection = DeviceConnection::kAbsent, .problem = "no fake on any port: plug it in"});
  const grpc::Status status = rig.Enable("fake-usb");
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(Has(status, "no fake on any port: plug it in")) << status.error_message();
  EXPECT_EQ(rig.Get().health().problem(), "no fake on any port: plug it in");
  EXPECT_EQ(rig.Get().health().connection(), v1::DEVICE_CONNECTION_ABSENT);
  rig.device.status = DeviceStatus::kOk;
  EXPECT_TRUE(rig.Enable("fake-usb").ok());
}

TEST(DeviceService, HeldStopButtonsWinOverEnable) {
  DeviceServiceRig rig;
  rig.device.buttons = kBothButtons;
  EXPECT_EQ(rig.Enable("fake-usb").error_code(), StatusCode::FAILED_PRECONDITION);
  // Nobody's call has stopped them, and the one that asked to enable them was refused.
  EXPECT_EQ(rig.Get().forces_set_by(), "");
  rig.device.buttons = 0;
  EXPECT_TRUE(rig.Enable("fake-usb").ok());
}

TEST(DeviceService, ADockedStylusIsHeldAndThatIsNoError) {
  DeviceServiceRig rig;
  rig.device.docked = true;
  ASSERT_TRUE(rig.Enable("fake-usb").ok());
  EXPECT_EQ(rig.answer.state(), v1::FORCE_STATE_HELD);
  EXPECT_EQ(rig.answer.reason(), v1::FORCE_REASON_DOCKED);
  rig.device.docked = false;
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_ON));
}

// Forces that are enabled in a replay come at its end. Stopped in it, they stay so.
TEST(DeviceService, ForcesAreHeldInAReplay) {
  DeviceServiceRig rig;
  rig.session().SetForcesOff(true);
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_OFF));  // after the first tick
  ASSERT_TRUE(rig.Enable("fake-usb").ok());
  EXPECT_EQ(rig.answer.state(), v1::FORCE_STATE_HELD);
  EXPECT_EQ(rig.answer.reason(), v1::FORCE_REASON_REPLAY);
  EXPECT_EQ(rig.Get().forces().reason(), v1::FORCE_REASON_REPLAY);
  rig.session().SetForcesOff(false);
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_ON));
  rig.session().SetForcesOff(true);
  ASSERT_TRUE(rig.Stop().ok());
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_STOPPED);
  rig.session().SetForcesOff(false);
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_STOPPED);
}

TEST(DeviceService, AStopOfAServoThatStandsStaysSet) {
  DeviceServiceRig rig(VerificationLevel::kNone, false);
  EXPECT_FALSE(rig.Get().has_forces());
  EXPECT_EQ(rig.Stop().error_code(), StatusCode::UNAVAILABLE);
  // What comes after the stop does not undo it.
  EXPECT_EQ(rig.Enable("fake-usb").error_code(), StatusCode::UNAVAILABLE);
  rig.servo().Start();
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_STOPPED));
  EXPECT_EQ(rig.device.pushes, 0);
}

// Samples that nobody carries say nothing about the loop.
TEST(DeviceService, AnswersWhileThePumpStandsStill) {
  DeviceServiceRig rig;
  ASSERT_TRUE(rig.Enable("fake-usb").ok());
  rig.pump().Stop();
  for (int n = 0; n < 3; ++n) {
    const grpc::Status stop = rig.Stop();
    ASSERT_TRUE(stop.ok()) << stop.error_message();
    EXPECT_EQ(rig.answer.state(), v1::FORCE_STATE_STOPPED);
    const std::uint64_t stopped_tick = rig.applied_tick;
    const grpc::Status enable = rig.Enable("fake-usb");
    ASSERT_TRUE(enable.ok()) << enable.error_message();
    EXPECT_GT(rig.applied_tick, stopped_tick);
    EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_ON));
  }
  ASSERT_TRUE(rig.Disable().ok());
  EXPECT_EQ(rig.answer.state(), v1::FORCE_STATE_OFF);
}

TEST(DeviceService, TheListMarksTheOneInUseAndTellsWhyThereIsNone) {
  DeviceServiceRig rig;
  const auto in_use = [&] {
    v1::ListDevicesResponse response;
    EXPECT_TRUE(rig.List(response).ok());
    std::string marks;
    for (const v1::ListedDevice& device : response.devices()) marks += device.in_use() ? '1' : '0';
    return marks;
  };
  const ListedDevice other{.kind = "falcon", .usable = true};
  const ListedDevice broken{.kind = "fake-usb", .port = "1-1", .problem = "no permission"};
  const ListedDevice works{.kind = "fake-usb", .port = "1-2", .usable = true};
  EXPECT_EQ(in_use(), "");
  rig.list = {other};
  EXPECT_EQ(in_use(), "0");
  rig.list = {other, broken};
  EXPECT_EQ(in_use(), "01");
  rig.list = {other, broken, works, works};
  EXPECT_EQ(in_use(), "0010");
  rig.list = {broken, broken};
  EXPECT_EQ(in_use(), "00");

  rig.no_list.emplace(ErrorKind::kPermissionDenied, "no USB here: mount it");
  v1::ListDevicesResponse response;
  const grpc::Status status = rig.List(response);
  EXPECT_EQ(status.error_code(), StatusCode::PERMISSION_DENIED);
  EXPECT_EQ(status.error_message(), "no USB here: mount it");
}

// A client of a later version must not move another hand than it names.
TEST(DeviceService, AnotherHandIsRefused) {
  using Stub = v1::DeviceService::Stub;
  DeviceServiceRig rig;
  const auto refuses = [&](auto method, auto request, auto response) {
    request.set_hand(1);
    EXPECT_EQ(rig.Call(method, request, response).error_code(), StatusCode::INVALID_ARGUMENT)
        << request.GetTypeName();
  };
  ASSERT_TRUE(rig.Enable("fake-usb").ok());
  refuses(&Stub::GetDevice, v1::GetDeviceRequest(), v1::GetDeviceResponse());
  v1::EnableForcesRequest enable;
  enable.set_device("fake-usb");
  refuses(&Stub::EnableForces, enable, v1::EnableForcesResponse());
  refuses(&Stub::DisableForces, v1::DisableForcesRequest(), v1::DisableForcesResponse());
  refuses(&Stub::CalibrateDevice, v1::CalibrateDeviceRequest(), v1::CalibrateDeviceResponse());
  refuses(&Stub::PushHand, v1::PushHandRequest(), v1::PushHandResponse());
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_ON));
  v1::DisableForcesRequest disable;
  disable.set_hand(0);
  v1::DisableForcesResponse disabled;
  EXPECT_TRUE(rig.Call(&Stub::DisableForces, disable, disabled).ok());
}

TEST(DeviceService, APushIsSmallShortAndNeedsForces) {
  using Stub = v1::DeviceService::Stub;
  DeviceServiceRig rig;
  const auto push = [&](double y_n, double seconds) {
    v1::PushHandRequest request;
    request.mutable_force_n()->set_y(y_n);
    request.set_seconds(seconds);
    v1::PushHandResponse response;
    return rig.Call(&Stub::PushHand, request, response).error_code();
  };
  EXPECT_EQ(push(0.3, 0.5), StatusCode::FAILED_PRECONDITION);
  ASSERT_TRUE(rig.Enable("fake-usb").ok());
  ASSERT_TRUE(rig.Becomes(v1::FORCE_STATE_ON));
  for (const double bad_n : {0.51, -1e300, test::kNan, test::kInfinity}) {
    EXPECT_EQ(push(bad_n, 0.5), StatusCode::INVALID_ARGUMENT) << bad_n;
  }
  for (const double bad_s : {0.0, -1.0, 5.1, test::kNan, test::kInfinity}) {
    EXPECT_EQ(push(0.3, bad_s), StatusCode::INVALID_ARGUMENT) << bad_s;
  }
  EXPECT_EQ(rig.device.pushes, 0);
  EXPECT_EQ(push(-0.5, 0.1), StatusCode::OK);
  EXPECT_TRUE(test::Eventually([&] { return rig.device.pushes >= 90; }));
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_ON));  // by the ramp after it
  EXPECT_LE(rig.device.pushes, 120);             // and the way to zero
  // Of any 10 s, 5 s. The newest push replaces the one before.
  EXPECT_EQ(push(-0.5, 5.0), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(push(-0.5, 4.5), StatusCode::OK);
  EXPECT_EQ(push(0.0, 0.001), StatusCode::OK);
}

TEST(DeviceService, APushEndsWhenItsCallerMayPushNoMore) {
  DeviceServiceRig rig;
  ASSERT_TRUE(rig.Enable("fake-usb").ok());
  ASSERT_TRUE(rig.Becomes(v1::FORCE_STATE_ON));
  v1::PushHandRequest request;
  request.mutable_force_n()->set_y(0.3);
  request.set_seconds(5.0);
  v1::PushHandResponse response;
  ASSERT_TRUE(rig.Call(&v1::DeviceService::Stub::PushHand, request, response).ok());
  const auto is_pushed = [&] {
    const int before = rig.device.pushes;
    const std::uint64_t tick = rig.servo().ticks();
    EXPECT_TRUE(test::Eventually([&] { return rig.servo().ticks() > tick + 20; }));
    return rig.device.pushes > before;
  };
  EXPECT_TRUE(is_pushed());
  rig.Review(Role::kAdmin);
  EXPECT_TRUE(is_pushed());
  rig.Review(Role::kEditor);
  EXPECT_TRUE(test::Eventually([&] { return !is_pushed(); }));
}

TEST(DeviceService, CalibratesOnlyWhatIsThere) {
  DeviceServiceRig rig;
  v1::CalibrateDeviceResponse response;
  rig.device.SetHealth({.problem = "plug it in"});
  grpc::Status status = rig.Calibrate(response);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(Has(status, "plug it in")) << status.error_message();
  rig.device.SetHealth({.connection = DeviceConnection::kConnecting});
  status = rig.Calibrate(response);
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  rig.device.SetHealth({.connection = DeviceConnection::kStreaming});
  EXPECT_EQ(rig.Calibrate(response, "falcon").error_code(), StatusCode::INVALID_ARGUMENT);
  ASSERT_TRUE(rig.Calibrate(response).ok());
  EXPECT_TRUE(response.health().calibrated());
  ASSERT_TRUE(rig.Calibrate(response, "fake-usb").ok());
}

TEST(DeviceService, AnArmThatMovesByItselfIsNamedAndItsForcesAreOff) {
  DeviceServiceRig rig;
  v1::CalibrateDeviceResponse response;
  rig.device.MoveArmToCalibrate();
  const grpc::Status status = rig.Calibrate(response);
  EXPECT_EQ(status.error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_TRUE(Has(status, "calibrate fake-usb")) << status.error_message();
  EXPECT_EQ(rig.Calibrate(response, "falcon").error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_TRUE(rig.Calibrate(response, "fake-usb").ok());
  EXPECT_TRUE(rig.Disable().ok());
  EXPECT_EQ(rig.device.stops, 1);
  EXPECT_TRUE(rig.Stop().ok());
  EXPECT_EQ(rig.device.stops, 3);  // the call's and the servo's
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_STOPPED));
  EXPECT_EQ(rig.Calibrate(response, "fake-usb").error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(rig.Disable().ok());
  // Held forces would come back once it is calibrated.
  rig.device.docked = true;
  ASSERT_TRUE(rig.Enable("fake-usb").ok());
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_HELD));
  EXPECT_EQ(rig.Calibrate(response, "fake-usb").error_code(), StatusCode::FAILED_PRECONDITION);
}

// Of one caller, as all on the socket are.
TEST(DeviceService, QuestionsThatTookTooMuchAreRefusedBeforeTheyWork) {
  DeviceServiceRig rig;
  v1::ListDevicesResponse response;
  rig.list_work_s = 1.0;
  EXPECT_TRUE(rig.List(response).ok());
  rig.list_work_s = 0.0;
  EXPECT_EQ(rig.List(response).error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(rig.lists, 1);
  EXPECT_TRUE(rig.Stop().ok());
  EXPECT_TRUE(rig.Disable().ok());
  EXPECT_TRUE(test::Eventually([&] { return rig.List(response).ok(); }));
}

TEST(DeviceService, AnArmThatMovesByItselfHasNoForcesAndIsStoppedByTheStylus) {
  DeviceServiceRig rig;
  rig.device.moves = true;
  const grpc::Status status = rig.Enable("fake-usb");
  EXPECT_EQ(status.error_code(), StatusCode::FAILED_PRECONDITION);
  EXPECT_TRUE(Has(status, "arm")) << status.error_message();
  EXPECT_EQ(rig.Get().forces().state(), v1::FORCE_STATE_OFF);
  EXPECT_EQ(rig.device.stops, 0);
  rig.device.buttons = kBothButtons;
  EXPECT_TRUE(test::Eventually([&] { return rig.device.stops == 1; }));
  EXPECT_TRUE(rig.Becomes(v1::FORCE_STATE_STOPPED));
  EXPECT_EQ(rig.device.stops, 1);
}

}  // namespace
}  // namespace palpate
