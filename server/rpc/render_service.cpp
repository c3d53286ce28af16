#include "server/rpc/render_service.h"

#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/status.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

v1::RenderSettings ToProto(const RenderSettings& settings) {
  v1::RenderSettings out;
  out.set_isovalue(settings.isovalue);
  out.set_normalized_isovalue(settings.normalized_isovalue);
  out.set_stiffness_n_per_mm(settings.haptics.stiffness_n_per_mm);
  out.set_damping_n_s_per_m(settings.haptics.damping_n_s_per_m);
  out.set_method(palpate::ToProto(settings.method));
  return out;
}

template <class T>
T Required(bool present, const T& value, const std::string& path) {
  if (present) return value;
  throw Error(ErrorKind::kInvalidArgument, "update_mask names " + path + ", which has no value");
}

}  // namespace

SettingsUpdate FromProto(const v1::UpdateSettingsRequest& request) {
  const v1::RenderSettings& in = request.settings();
  SettingsUpdate update;
  for (const std::string& path : request.update_mask().paths()) {
    if (path == "isovalue") {
      update.isovalue = Required(in.has_isovalue(), in.isovalue(), path);
    } else if (path == "normalized_isovalue") {
      update.normalized_isovalue =
          Required(in.has_normalized_isovalue(), in.normalized_isovalue(), path);
    } else if (path == "stiffness_n_per_mm") {
      update.stiffness_n_per_mm =
          Required(in.has_stiffness_n_per_mm(), in.stiffness_n_per_mm(), path);
    } else if (path == "damping_n_s_per_m") {
      update.damping_n_s_per_m = Required(in.has_damping_n_s_per_m(), in.damping_n_s_per_m(), path);
    } else if (path == "method") {
      update.method = palpate::FromProto(Required(in.has_method(), in.method(), path));
    } else {
      throw Error(ErrorKind::kInvalidArgument, "update_mask names an unknown field: " + path);
    }
  }
  if (request.update_mask().paths().empty()) {
    throw Error(ErrorKind::kInvalidArgument, "update_mask is empty: name the fields to change");
  }
  if (request.has_expected_revision()) update.expected_revision = request.expected_revision();
  return update;
}

grpc::Status RenderService::GetSettings(grpc::ServerContext*, const v1::GetSettingsRequest*,
                                        v1::GetSettingsResponse* response) {
  const SettingsState state = session_.settings();
  *response->mutable_settings() = ToProto(state.settings);
  response->set_settings_revision(state.settings_revision);
  return grpc::Status::OK;
}

grpc::Status RenderService::UpdateSettings(grpc::ServerContext*,
                                           const v1::UpdateSettingsRequest* request,
                                           v1::UpdateSettingsResponse* response) {
  const std::int64_t received_ns = MonotonicNowNs();
  try {
    const SettingsApplied result = session_.Update(FromProto(*request));
    *response->mutable_settings() = ToProto(result.state.settings);
    response->set_settings_revision(result.state.settings_revision);
    response->set_applied_tick(result.applied.tick);
    response->set_receipt_to_applied_ns(result.applied.time_ns - received_ns);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

}  // namespace palpate
