#include "client/sdk/calls.h"

#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>

#include "client/sdk/device.h"
#include "client/sdk/link.h"
#include "client/sdk/messages.h"
#include "common/error/error.h"
#include "common/wire/address.h"
#include "palpate/v1/activity.grpc.pb.h"
#include "palpate/v1/device.grpc.pb.h"
#include "palpate/v1/recording.grpc.pb.h"
#include "palpate/v1/registration.grpc.pb.h"
#include "palpate/v1/render.grpc.pb.h"
#include "palpate/v1/series.grpc.pb.h"

namespace palpate::client {
namespace {

// palpated answers within a second. In a flood it may close a connection: the next one may pass.
constexpr timeval kSocketPatience{1, 500'000};
constexpr int kSocketTries = 3;

// Asks the stop's socket. Returns the answer. Empty: the connection was closed. None: nobody
// answers.
std::optional<std::string> AskSocket(const sockaddr_un& address) {
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return std::nullopt;
  setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &kSocketPatience, sizeof(kSocketPatience));
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &kSocketPatience, sizeof(kSocketPatience));
  constexpr std::string_view kRequest = "stop\n";
  std::optional<std::string> answer;
  if (connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0) {
    send(fd, kRequest.data(), kRequest.size(), MSG_NOSIGNAL);
    char text[256];
    // The answer is one write.
    const ssize_t length = recv(fd, text, sizeof(text), 0);
    if (length >= 0) answer.emplace(text, static_cast<std::size_t>(length));
    if (length < 0 && errno == ECONNRESET) answer.emplace();
  }
  close(fd);
  return answer;
}

// The emergency stop by palpated's own socket for it (server/stop/stop_door.h).
//
// `path`: of the stop's socket. Returns what the forces are then; none if nobody answers there, as
// with a palpated of the last release: then the stop must go by gRPC. Takes up to some seconds.
// Errors: kUnavailable: the loop does not tick, and the stop acts in its next tick.
std::optional<ForceResult> StopBySocket(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof(address.sun_path)) return std::nullopt;
  std::memcpy(address.sun_path, path.data(), path.size());
  for (int n = 0; n < kSocketTries; ++n) {
    const std::optional<std::string> said = AskSocket(address);
    if (!said) return std::nullopt;
    std::istringstream answer(*said);
    std::string state, reason;
    ForceResult result;
    answer >> state;
    if (state == "waits") {
      throw Error(ErrorKind::kUnavailable,
                  "the haptic loop did not tick within 1 s: the stop holds from its next tick on; "
                  "look at palpated's log, or end it");
    }
    result.forces.state = Named<ForceState>(state).value_or(ForceState::kUnknown);
    if (result.forces.state != ForceState::kUnknown && answer >> reason >> result.applied_tick >>
                                                           result.forces.limit_n >>
                                                           result.forces.torque_limit_n_mm) {
      result.forces.reason = Named<ForceReason>(reason).value_or(ForceReason::kUnknown);
      return result;
    }
  }
  return std::nullopt;
}

using Device = v1::DeviceService;
using Recording = v1::RecordingService;
using RegistrationService = v1::RegistrationService;

// Of a stop by socket or by gRPC. palpated waits for a second for a loop that does not tick.
constexpr std::chrono::seconds kStopTimeout{3};

// Reads the answer of EnableForces, DisableForces or StopForces.
template <typename Response>
ForceResult ForceResultOf(const Response& response) {
  return {FromProto(response.forces()), response.applied_tick()};
}

}  // namespace

Calls::Calls(const Server& server) : link_(std::make_unique<Link>(server)) {}
Calls::~Calls() = default;

void Calls::SilenceTransport() { setenv("GRPC_VERBOSITY", "NONE", 0); }

std::string Calls::name() const { return link_->name(); }
bool Calls::shares_clock() const { return link_->shares_clock(); }
void Calls::WaitUntilReached(std::chrono::milliseconds timeout) {
  link_->WaitUntilReached(timeout);
}
void Calls::SetOnLoading(std::function<bool(const std::string&)> call) {
  link_->SetOnLoading(std::move(call));
}
void Calls::EndCalls() { link_->CancelCalls(); }

PoseReader Calls::ReadPoses(double rate_hz, std::uint32_t batch) {
  return PoseReader(*link_, rate_hz, batch);
}

Settings Calls::GetSettings() {
  const v1::GetSettingsResponse response = link_->Call<v1::RenderService>(
      &v1::RenderService::Stub::GetSettings, v1::GetSettingsRequest());
  return FromProto(response.settings(), response.settings_revision(), response.ball(),
                   response.replayed());
}

SettingsResult Calls::Set(const SettingsUpdate& update) {
  const v1::UpdateSettingsResponse response =
      link_->Call<v1::RenderService>(&v1::RenderService::Stub::UpdateSettings, ToProto(update));
  return {FromProto(response.settings(), response.settings_revision(), response.ball()),
          response.applied_tick(), response.receipt_to_applied_ns(), response.not_kept()};
}

PlacementNow Calls::GetPlacement() {
  return FromProto(link_->Call<RegistrationService>(&RegistrationService::Stub::GetRegistration,
                                                    v1::GetRegistrationRequest()));
}

PlacementResult Calls::Place(const PlacementChange& change) {
  if (change.device_mm_per_volume_mm && change.device_mm_per_voxel) {
    throw Error(ErrorKind::kInvalidArgument, "give the scale per mm or per voxel, not both");
  }
  return FromProto(link_->Call<RegistrationService>(&RegistrationService::Stub::UpdateRegistration,
                                                    ToProto(change)));
}

SeriesState Calls::GetSeries() {
  return FromProto(
      link_->Call<v1::SeriesService>(&v1::SeriesService::Stub::GetSeries, v1::GetSeriesRequest())
          .series());
}

SeriesControlled Calls::ControlSeries(const SeriesControl& control) {
  return FromProto(
      link_->Call<v1::SeriesService>(&v1::SeriesService::Stub::ControlSeries, ToProto(control)));
}

DaemonInfo Calls::GetDevice() {
  return FromProto(link_->Call<Device>(&Device::Stub::GetDevice, v1::GetDeviceRequest()));
}

std::vector<ListedDevice> Calls::ListDevices() {
  const v1::ListDevicesResponse response =
      link_->Call<Device>(&Device::Stub::ListDevices, v1::ListDevicesRequest());
  std::vector<ListedDevice> devices;
  for (const v1::ListedDevice& device : response.devices()) devices.push_back(FromProto(device));
  return devices;
}

ForceResult Calls::EnableForces(const std::string& device) {
  v1::EnableForcesRequest request;
  request.set_device(device);
  return ForceResultOf(link_->Call<Device>(&Device::Stub::EnableForces, request));
}

ForceResult Calls::DisableForces() {
  return ForceResultOf(
      link_->Call<Device>(&Device::Stub::DisableForces, v1::DisableForcesRequest()));
}

ForceResult Calls::StopForces() {
  link_->ThrowIfCancelled();
  if (link_->shares_clock()) {
    if (auto result = StopBySocket(FindStopSocket(link_->socket_path()))) return *result;
  }
  const auto stop_on = [this](const std::shared_ptr<grpc::Channel>& channel) {
    return ForceResultOf(link_->Call<Device>(&Device::Stub::StopForces, v1::StopForcesRequest(),
                                             kStopTimeout, channel));
  };
  try {
    return stop_on(link_->stop_channel());
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kUnavailable) throw;
  }
  return stop_on(link_->channel());  // palpated may have had one connection too many
}

DeviceHealth Calls::CalibrateDevice(const std::string& device) {
  v1::CalibrateDeviceRequest request;
  request.set_device(device);
  return FromProto(link_->Call<Device>(&Device::Stub::CalibrateDevice, request).health());
}

std::uint64_t Calls::PushHand(const Vec3& force_n, double seconds) {
  v1::PushHandRequest request;
  *request.mutable_force_n() = ToProto(force_n);
  request.set_seconds(seconds);
  return link_->Call<Device>(&Device::Stub::PushHand, request).applied_tick();
}

std::unique_ptr<HandLead> Calls::LeadHand() { return std::make_unique<HandLead>(*link_); }

Activity Calls::GetActivity() {
  return FromProto(link_->Call<v1::ActivityService>(&v1::ActivityService::Stub::GetActivity,
                                                    v1::GetActivityRequest()));
}

unsigned Calls::EndCaller(const std::string& identity) {
  v1::EndCallerRequest request;
  request.set_identity(identity);
  return link_->Call<v1::ActivityService>(&v1::ActivityService::Stub::EndCaller, request)
      .ended_calls();
}

RecordingState Calls::StartRecording(const std::string& path, bool overwrite) {
  v1::StartRecordingRequest request;
  request.set_path(path);
  request.set_overwrite(overwrite);
  return FromProto(link_->Call<Recording>(&Recording::Stub::StartRecording, request).recording());
}

RecordingState Calls::StopRecording() {
  return FromProto(
      link_->Call<Recording>(&Recording::Stub::StopRecording, v1::StopRecordingRequest())
          .recording());
}

RecordingState Calls::GetRecording() {
  return FromProto(link_->Call<Recording>(&Recording::Stub::GetRecording, v1::GetRecordingRequest())
                       .recording());
}

std::int64_t Calls::Mark(const std::string& text) {
  v1::MarkRequest request;
  request.set_text(text);
  return link_->Call<Recording>(&Recording::Stub::Mark, request).time_ns();
}

ReplayState Calls::Replay(const std::string& path, const ReplayOptions& options,
                          const ReplayFunction& progress) {
  v1::ReplayRequest request;
  request.set_path(path);
  request.set_speed(options.speed);
  request.set_first_tick(options.first_tick);
  ReplayState state;
  link_->Stream<Recording, v1::ReplayResponse>(
      request,
      [&](Recording::Stub& stub, auto* context, auto* queue) {
        return stub.PrepareAsyncReplay(context, request, queue);
      },
      [&](const v1::ReplayResponse& event) {
        // The markers come once.
        std::vector<RecordedMarker> markers = std::move(state.markers);
        state = FromProto(event);
        if (state.markers.empty()) state.markers = std::move(markers);
      },
      [&] {
        const bool goes_on = !progress || progress(state);
        state.marker.clear();
        return goes_on;
      },
      "the replay was cancelled");
  return state;
}

RecordingList Calls::ListRecordings() {
  return FromProto(
      link_->Call<Recording>(&Recording::Stub::ListRecordings, v1::ListRecordingsRequest()));
}

}  // namespace palpate::client
