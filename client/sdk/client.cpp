#include "client/sdk/client.h"

#include <functional>
#include <utility>

#include "client/sdk/link.h"
#include "client/sdk/messages.h"
#include "client/sdk/monitor.h"
#include "client/sdk/pose_follower.h"
#include "client/sdk/server_choice.h"
#include "client/sdk/settings_follower.h"
#include "client/sdk/volume_follower.h"
#include "palpate/v1/device.grpc.pb.h"
#include "palpate/v1/recording.grpc.pb.h"
#include "palpate/v1/render.grpc.pb.h"
#include "palpate/v1/series.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::client {
namespace {

// The threads that call back take an Error for a loss: a callback's own is none.
template <typename... Arguments>
std::function<void(Arguments...)> EndingIfItThrows(std::function<void(Arguments...)> callback) {
  if (!callback) return callback;
  return
      [callback = std::move(callback)](Arguments... arguments) noexcept { callback(arguments...); };
}

}  // namespace

class Client::Parts {
 public:
  explicit Parts(ClientOptions options)
      : link(Resolve({options.profile, options.address, options.credentials})),
        settings(link, monitor, EndingIfItThrows(std::move(options.callbacks.on_settings))),
        poses(link, monitor, options.poses, Events(options.callbacks)) {
    if (options.follow_volume) {
      volume.emplace(link, monitor, EndingIfItThrows(std::move(options.callbacks.on_volume)));
    }
  }
  ~Parts() { End(); }

  void End() {
    monitor.Stop();
    link.CancelCalls();
  }

  // Last, when all is there that the threads touch.
  void Begin() {
    settings.Begin();
    if (volume) volume->Begin();
    poses.Begin();
  }

  Link link;
  Monitor monitor;
  // Their destructors join, the last one first.
  SettingsFollower settings;
  std::optional<VolumeFollower> volume;
  PoseFollower poses;

 private:
  PoseFollower::Events Events(Callbacks& callbacks) {
    return {.connection = EndingIfItThrows(std::move(callbacks.on_connection)),
            .poses = EndingIfItThrows(std::move(callbacks.on_poses)),
            .first_settings =
                [this](const v1::GetSettingsResponse& response) {
                  settings.Replace(FromProto(response.settings(), response.settings_revision()));
                },
            .settings_changed = [this] { settings.Ask(); }};
  }
};

Client::Client(ClientOptions options) : parts_(std::make_unique<Parts>(std::move(options))) {
  parts_->Begin();
}

Client::~Client() = default;

void Client::EndCalls() { parts_->link.CancelCalls(); }

void Client::Disconnect() {
  parts_->End();
  parts_->poses.End();
  parts_->link.Renew();
  parts_->monitor.Set({ConnectionState::kLost, "disconnected"});
}

Connection Client::connection() const { return parts_->monitor.connection(); }

bool Client::WaitUntilConnected(std::chrono::milliseconds timeout) const {
  return parts_->monitor.WaitUntilConnected(timeout) != 0;
}

const std::string& Client::name() const { return parts_->link.name(); }
bool Client::shares_clock() const { return parts_->link.shares_clock(); }

std::optional<Pose> Client::NewestPose() const { return parts_->poses.Newest(); }
std::uint64_t Client::dropped_poses() const { return parts_->poses.dropped(); }
void Client::SetPoseRate(const PoseRate& rate) { parts_->poses.SetRate(rate); }

std::optional<Settings> Client::NewestSettings() const { return parts_->settings.Newest(); }

Settings Client::GetSettings() {
  const std::uint64_t epoch = parts_->monitor.epoch();
  const v1::GetSettingsResponse response = parts_->link.Call<v1::RenderService>(
      &v1::RenderService::Stub::GetSettings, v1::GetSettingsRequest());
  const Settings settings = FromProto(response.settings(), response.settings_revision());
  parts_->settings.Take(settings, epoch);
  return settings;
}

SettingsResult Client::Set(const SettingsUpdate& update) {
  const std::uint64_t epoch = parts_->monitor.epoch();
  const v1::UpdateSettingsResponse response = parts_->link.Call<v1::RenderService>(
      &v1::RenderService::Stub::UpdateSettings, ToProto(update));
  const Settings settings = FromProto(response.settings(), response.settings_revision());
  parts_->settings.Take(settings, epoch);
  return {settings, response.applied_tick()};
}

EditResult Client::Apply(const Edit& edit) {
  return FromProto(
      parts_->link.Call<v1::VolumeService>(&v1::VolumeService::Stub::EditVolume, ToProto(edit)));
}
EditResult Client::RunFilter(const Filter& filter,
                             const std::function<bool(double fraction)>& progress) {
  std::optional<EditResult> result;
  parts_->link.Stream<v1::VolumeService>(
      [request = ToProto(filter)](v1::VolumeService::Stub& stub, grpc::ClientContext& context) {
        return stub.FilterVolume(&context, request);
      },
      [&](const v1::FilterVolumeResponse& event) {
        if (event.has_result()) result = FromProto(event.result());
        return !event.has_progress() || progress(event.progress().fraction());
      });
  if (!result) throw Error(ErrorKind::kInternal, "palpated ended the filter without a result");
  return *result;
}
EditResult Client::Undo(std::optional<std::uint64_t> expected_revision) {
  v1::UndoEditRequest request;
  if (expected_revision) request.set_expected_revision(*expected_revision);
  return FromProto(
      parts_->link.Call<v1::VolumeService>(&v1::VolumeService::Stub::UndoEdit, request));
}
EditResult Client::Redo(std::optional<std::uint64_t> expected_revision) {
  v1::RedoEditRequest request;
  if (expected_revision) request.set_expected_revision(*expected_revision);
  return FromProto(
      parts_->link.Call<v1::VolumeService>(&v1::VolumeService::Stub::RedoEdit, request));
}
EditResult Client::Revert() {
  return FromProto(parts_->link.Call<v1::VolumeService>(&v1::VolumeService::Stub::RevertVolume,
                                                        v1::RevertVolumeRequest()));
}

std::optional<VolumeUpdate> Client::TakeVolumeUpdate() {
  return parts_->volume ? parts_->volume->Take() : std::nullopt;
}
VolumeStatus Client::volume_status() const {
  return parts_->volume ? parts_->volume->status() : VolumeStatus();
}

DeviceInfo Client::GetDevice() {
  return FromProto(parts_->link.Call<v1::DeviceService>(&v1::DeviceService::Stub::GetDevice,
                                                        v1::GetDeviceRequest()));
}
ForceResult Client::EnableForces(const std::string& device) {
  v1::EnableForcesRequest request;
  request.set_device(device);
  const auto response =
      parts_->link.Call<v1::DeviceService>(&v1::DeviceService::Stub::EnableForces, request);
  return {FromProto(response.forces()), response.applied_tick()};
}
ForceResult Client::DisableForces() {
  const auto response = parts_->link.Call<v1::DeviceService>(
      &v1::DeviceService::Stub::DisableForces, v1::DisableForcesRequest());
  return {FromProto(response.forces()), response.applied_tick()};
}
ForceResult Client::StopForces() {
  const auto response = parts_->link.Call<v1::DeviceService>(&v1::DeviceService::Stub::StopForces,
                                                             v1::StopForcesRequest());
  return {FromProto(response.forces()), response.applied_tick()};
}

SeriesState Client::GetSeries() {
  return FromProto(
      parts_->link
          .Call<v1::SeriesService>(&v1::SeriesService::Stub::GetSeries, v1::GetSeriesRequest())
          .series());
}
SeriesState Client::ControlSeries(const SeriesControl& control) {
  return FromProto(
      parts_->link
          .Call<v1::SeriesService>(&v1::SeriesService::Stub::ControlSeries, ToProto(control))
          .series());
}

RecordingState Client::StartRecording(const std::string& path, bool overwrite) {
  v1::StartRecordingRequest request;
  request.set_path(path);
  request.set_overwrite(overwrite);
  return FromProto(
      parts_->link.Call<v1::RecordingService>(&v1::RecordingService::Stub::StartRecording, request)
          .recording());
}
RecordingState Client::StopRecording() {
  return FromProto(parts_->link
                       .Call<v1::RecordingService>(&v1::RecordingService::Stub::StopRecording,
                                                   v1::StopRecordingRequest())
                       .recording());
}
RecordingState Client::GetRecording() {
  return FromProto(parts_->link
                       .Call<v1::RecordingService>(&v1::RecordingService::Stub::GetRecording,
                                                   v1::GetRecordingRequest())
                       .recording());
}
std::int64_t Client::Mark(const std::string& text) {
  v1::MarkRequest request;
  request.set_text(text);
  return parts_->link.Call<v1::RecordingService>(&v1::RecordingService::Stub::Mark, request)
      .time_ns();
}

}  // namespace palpate::client
