#include "tests/load/churn.h"

#include <chrono>
#include <memory>
#include <random>
#include <utility>

#include "palpate/v1/render.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::load {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds kPatience{10};
// After a stop of the machine the calls that it held up are not all made at once.
constexpr std::chrono::milliseconds kLongestBacklog{200};

void SetDeadline(grpc::ClientContext& context) {
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
}

}  // namespace

SteadyCaller::SteadyCaller(double rate_hz, std::function<grpc::Status(std::uint64_t)> call)
    : rate_hz_(rate_hz), call_(std::move(call)), thread_([this] { Run(); }) {}

void SteadyCaller::Stop() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void SteadyCaller::Run() {
  const auto period =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz_));
  auto next = Clock::now();
  while (!stop_) {
    const grpc::Status status = call_(calls_++);
    if (!status.ok()) error_ = status.error_message();
    next = std::max(next + period, Clock::now() - kLongestBacklog);
    std::this_thread::sleep_until(next);
  }
}

std::function<grpc::Status(std::uint64_t)> SettingsCalls(const std::string& target) {
  std::shared_ptr<v1::RenderService::Stub> stub =
      v1::RenderService::NewStub(grpc::CreateChannel(target, grpc::InsecureChannelCredentials()));
  return [stub](std::uint64_t n) {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::UpdateSettingsRequest request;
    const double step = static_cast<double>(n / 2 % 10);
    if (n % 2 == 0) {
      request.mutable_settings()->set_stiffness_n_per_mm(0.45 + 0.01 * step);
      request.mutable_update_mask()->add_paths("stiffness_n_per_mm");
    } else {
      request.mutable_settings()->set_normalized_isovalue(0.495 + 0.001 * step);
      request.mutable_update_mask()->add_paths("normalized_isovalue");
    }
    v1::UpdateSettingsResponse response;
    return stub->UpdateSettings(&context, request, &response);
  };
}

std::function<grpc::Status(std::uint64_t)> EditCalls(const std::string& target, int edge,
                                                     unsigned seed) {
  std::shared_ptr<v1::VolumeService::Stub> stub =
      v1::VolumeService::NewStub(grpc::CreateChannel(target, grpc::InsecureChannelCredentials()));
  auto random = std::make_shared<std::mt19937>(seed);
  return [stub, random, edge](std::uint64_t) {
    std::uniform_real_distribution<double> place(0.0, edge - 1.0), amount(-0.05, 0.05);
    v1::EditVolumeRequest request;
    request.set_frame(v1::EDIT_FRAME_INDEX);
    request.set_operation(v1::EDIT_OPERATION_ADD);
    request.set_value(amount(*random));
    request.set_falloff(3.0);
    request.mutable_sphere()->set_radius(5.0);
    request.mutable_sphere()->mutable_center()->set_x(place(*random));
    request.mutable_sphere()->mutable_center()->set_y(place(*random));
    request.mutable_sphere()->mutable_center()->set_z(place(*random));
    grpc::ClientContext context;
    SetDeadline(context);
    v1::EditVolumeResponse response;
    return stub->EditVolume(&context, request, &response);
  };
}

}  // namespace palpate::load
