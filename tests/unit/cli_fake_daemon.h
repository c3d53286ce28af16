// A palpated with canned answers, for tests of the command line client.
//
// Threads: gRPC's own. Set the public members before a call and read them after it.
#pragma once

#include <grpcpp/grpcpp.h>
#include <time.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>

#include "common/wire/address.h"
#include "palpate/v1/device.grpc.pb.h"
#include "palpate/v1/pose.grpc.pb.h"
#include "palpate/v1/render.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::test {

inline void Set(v1::Vector3* vector, double x, double y, double z) {
  vector->set_x(x);
  vector->set_y(y);
  vector->set_z(z);
}

inline std::int64_t MonotonicNs() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1'000'000'000 + now.tv_nsec;
}

class FakeDeviceService final : public v1::DeviceService::Service {
 public:
  FakeDeviceService() {
    health.set_connection(v1::DEVICE_CONNECTION_STREAMING);
    health.set_calibrated(true);
    forces.set_state(v1::FORCE_STATE_ON);
    forces.set_reason(v1::FORCE_REASON_NONE);
    forces.set_limit_n(3.3);
  }

  v1::VerificationLevel level = v1::VERIFICATION_LEVEL_SIMULATED;
  v1::DeviceHealth health;
  v1::ForceStatus forces;
  v1::ListDevicesResponse list;
  std::string enabled_name = "none";
  // The rise of each count from one GetDevice to the next.
  std::uint64_t ticks_per_call = 0;
  std::uint64_t readings_per_call = 0;
  std::uint64_t lost_per_call = 0;
  std::uint64_t corrupt_per_call = 0;

 private:
  grpc::Status GetDevice(grpc::ServerContext*, const v1::GetDeviceRequest*,
                         v1::GetDeviceResponse* response) override {
    v1::DeviceDescription& device = *response->mutable_device();
    device.set_kind("simulated");
    device.set_model("Simulated stylus");
    device.set_max_force_n(3.3);
    device.set_verification_level(level);
    v1::ServoDescription& servo = *response->mutable_servo();
    servo.set_version("9.8.7");
    servo.set_rate_hz(1000.0);
    servo.add_warnings("no SCHED_FIFO: raise rtprio");
    servo.set_ticks(990 + calls_ * ticks_per_call);
    servo.set_missed_ticks(10);
    *response->mutable_health() = health;
    response->mutable_health()->set_readings(calls_ * readings_per_call);
    response->mutable_health()->set_lost_readings(calls_ * lost_per_call);
    response->mutable_health()->set_corrupt_frames(calls_ * corrupt_per_call);
    *response->mutable_forces() = forces;
    ++calls_;
    return grpc::Status::OK;
  }

  grpc::Status ListDevices(grpc::ServerContext*, const v1::ListDevicesRequest*,
                           v1::ListDevicesResponse* response) override {
    *response = list;
    return grpc::Status::OK;
  }

  // For "broken", the forces stay off.
  grpc::Status EnableForces(grpc::ServerContext*, const v1::EnableForcesRequest* request,
                            v1::EnableForcesResponse* response) override {
    enabled_name = request->device();
    if (request->device() == "other") {
      return {grpc::StatusCode::INVALID_ARGUMENT, "the daemon's device is `simulated`"};
    }
    if (request->device() == "broken") {
      return {grpc::StatusCode::FAILED_PRECONDITION, "forces stay off:\nplug it in"};
    }
    *response->mutable_forces() = forces;
    response->set_applied_tick(11);
    return grpc::Status::OK;
  }

  grpc::Status DisableForces(grpc::ServerContext*, const v1::DisableForcesRequest*,
                             v1::DisableForcesResponse* response) override {
    response->mutable_forces()->set_state(v1::FORCE_STATE_OFF);
    response->mutable_forces()->set_reason(v1::FORCE_REASON_OPERATOR);
    response->set_applied_tick(12);
    return grpc::Status::OK;
  }

  grpc::Status StopForces(grpc::ServerContext*, const v1::StopForcesRequest*,
                          v1::StopForcesResponse* response) override {
    response->mutable_forces()->set_state(v1::FORCE_STATE_STOPPED);
    response->mutable_forces()->set_reason(v1::FORCE_REASON_STOP_CALL);
    response->set_applied_tick(13);
    return grpc::Status::OK;
  }

  grpc::Status CalibrateDevice(grpc::ServerContext*, const v1::CalibrateDeviceRequest*,
                               v1::CalibrateDeviceResponse* response) override {
    *response->mutable_health() = health;
    return grpc::Status::OK;
  }

  std::uint64_t calls_ = 0;
};

class FakeRenderService final : public v1::RenderService::Service {
 public:
  v1::UpdateSettingsRequest last_update;

 private:
  grpc::Status GetSettings(grpc::ServerContext*, const v1::GetSettingsRequest*,
                           v1::GetSettingsResponse* response) override {
    FillIn(*response->mutable_settings());
    response->set_settings_revision(6);
    return grpc::Status::OK;
  }

  grpc::Status UpdateSettings(grpc::ServerContext*, const v1::UpdateSettingsRequest* request,
                              v1::UpdateSettingsResponse* response) override {
    last_update = *request;
    if (request->has_expected_revision() && request->expected_revision() != 6) {
      return {grpc::StatusCode::ABORTED, "settings are at revision 6"};
    }
    if (request->settings().stiffness_n_per_mm() > 3.0) {
      return {grpc::StatusCode::INVALID_ARGUMENT, "stiffness is 0 to 3 N/mm,\nnot more"};
    }
    FillIn(*response->mutable_settings());
    response->mutable_settings()->MergeFrom(request->settings());
    response->set_settings_revision(7);
    response->set_applied_tick(123456);
    response->set_receipt_to_applied_ns(1'200'000);
    return grpc::Status::OK;
  }

  static void FillIn(v1::RenderSettings& settings) {
    settings.set_isovalue(40.8);
    settings.set_normalized_isovalue(0.16);
    settings.set_stiffness_n_per_mm(0.5);
    settings.set_damping_n_s_per_m(0.0);
    settings.set_method(v1::DECOMPOSITION_METHOD_TPBCC);
  }
};

class FakeVolumeService final : public v1::VolumeService::Service {
 public:
  v1::LoadVolumeRequest last_load;
  std::atomic<bool> load_was_cancelled{false};

 private:
  static void FillIn(const std::string& source, v1::VolumeDescription& volume) {
    volume.set_source(source);
    volume.set_volume_revision(3);
    volume.set_size_x(64);
    volume.set_size_y(65);
    volume.set_size_z(66);
    Set(volume.mutable_spacing_mm(), 0.5, 0.5, 1.25);
    volume.set_value_max(255.0);
    volume.set_device_mm_per_volume_mm(1.5);
  }

  grpc::Status GetVolume(grpc::ServerContext*, const v1::GetVolumeRequest*,
                         v1::GetVolumeResponse* response) override {
    FillIn("builtin:sphere", *response->mutable_volume());
    return grpc::Status::OK;
  }

  // "slow" never ends; "absent" is not found.
  grpc::Status LoadVolume(grpc::ServerContext* context, const v1::LoadVolumeRequest* request,
                          grpc::ServerWriter<v1::LoadVolumeResponse>* writer) override {
    last_load = *request;
    const std::string& source = request->source();
    if (source.find("absent") != std::string::npos) {
      return {grpc::StatusCode::NOT_FOUND, "no file " + source};
    }
    for (int percent = 0; percent <= 100; percent += 10) {
      v1::LoadVolumeResponse response;
      response.mutable_progress()->set_stage("reading");
      response.mutable_progress()->set_fraction(percent / 100.0);
      writer->Write(response);
    }
    while (source.find("slow") != std::string::npos) {
      if (context->IsCancelled()) {
        load_was_cancelled = true;
        return grpc::Status::CANCELLED;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    v1::LoadVolumeResponse response;
    FillIn(source, *response.mutable_result()->mutable_volume());
    response.mutable_result()->set_applied_tick(777);
    response.mutable_result()->set_settings_revision(8);
    writer->Write(response);
    return grpc::Status::OK;
  }
};

// Sends a message, then waits for as many acknowledgements as the window requires.
class FakePoseService final : public v1::PoseService::Service {
 public:
  v1::StreamPosesStart last_start;
  std::atomic<std::uint64_t> acknowledged{0};

 private:
  using Stream = grpc::ServerReaderWriter<v1::StreamPosesResponse, v1::StreamPosesRequest>;

  grpc::Status StreamPoses(grpc::ServerContext* context, Stream* stream) override {
    v1::StreamPosesRequest request;
    if (!stream->Read(&request) || !request.has_start()) {
      return {grpc::StatusCode::INVALID_ARGUMENT, "start is missing"};
    }
    last_start = request.start();
    acknowledged = 0;
    const std::uint64_t step = static_cast<std::uint64_t>(1000.0 / last_start.rate_hz() + 0.5);
    std::uint64_t tick = 0;
    for (std::uint64_t number = 1; !context->IsCancelled(); ++number) {
      v1::StreamPosesResponse message;
      message.set_message_number(number);
      for (std::uint32_t i = 0; i < last_start.batch(); ++i, tick += step) {
        FillIn(tick, *message.add_samples());
      }
      message.set_sent_time_ns(MonotonicNs());
      if (!stream->Write(message)) {
        break;
      }
      while (number - acknowledged >= last_start.max_unacknowledged()) {
        if (!stream->Read(&request)) {
          return grpc::Status::OK;
        }
        acknowledged = request.acknowledgement().message_number();
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(step * last_start.batch()));
    }
    return grpc::Status::OK;
  }

  // Odd ticks are in contact.
  static void FillIn(std::uint64_t tick, v1::PoseSample& sample) {
    const bool contact = tick % 2 == 1;
    sample.set_tick(tick);
    sample.set_time_ns(MonotonicNs());
    Set(sample.mutable_hip_mm(), 0.1, 1.0 / 3.0, static_cast<double>(tick));
    Set(sample.mutable_scp_h_mm(), 1, 2, 3);
    sample.mutable_stylus_orientation()->set_w(1.0);
    Set(sample.mutable_force_n(), 0, contact ? 0.5 : 0.0, 0);
    sample.set_mode(contact ? v1::PROXY_MODE_CONSTRAINED : v1::PROXY_MODE_FREE);
    sample.set_contact(contact);
    if (contact) {
      Set(sample.mutable_scp_h_normal(), 0, 1, 0);
      Set(sample.mutable_scp_v_mm(), 1, 2.5, 3);
      Set(sample.mutable_scp_v_normal(), 0, 1, 0);
    }
    sample.set_density(40.0);
    sample.set_isovalue(40.8);
    sample.set_settings_revision(6);
    sample.set_volume_revision(3);
    sample.set_update_ns(3200);
    sample.set_missed_ticks(2);
  }
};

class FakeDaemon {
 public:
  // Listens on a Unix socket, and on a free port of 127.0.0.1. `complete` false: offers only one of
  // the services, as a server of another version may do.
  explicit FakeDaemon(const std::string& socket_path, bool complete = true) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort(UnixTarget(socket_path), grpc::InsecureServerCredentials());
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    if (complete) {
      builder.RegisterService(&device);
      builder.RegisterService(&render);
      builder.RegisterService(&volume);
      builder.RegisterService(&pose);
    } else {
      builder.RegisterService(&volume);
    }
    server_ = builder.BuildAndStart();
  }
  ~FakeDaemon() { Die(); }

  // Ends all calls at once.
  void Die() { server_->Shutdown(std::chrono::system_clock::now()); }

  int port = 0;
  FakeDeviceService device;
  FakeRenderService render;
  FakeVolumeService volume;
  FakePoseService pose;

 private:
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace palpate::test
