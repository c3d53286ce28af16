#include "server/rpc/volume_save.h"

#include "common/error/error.h"
#include "server/log/log.h"
#include "server/volume/volume_export.h"

namespace palpate {

grpc::Status VolumeSaver::Save(grpc::ServerContext* context, const Admission& admission,
                               const v1::SaveVolumeRequest& request,
                               grpc::ServerWriter<v1::SaveVolumeResponse>* writer) {
  try {
    v1::SaveVolumeResponse event;
    *event.mutable_result() = SaveChecked(context, admission, request, writer);
    admission.Write(*writer, event);
    LogInfo("saved volume revision {} to {} ({} bytes)", event.result().volume_revision(),
            request.path(), event.result().size_bytes());
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return admission.Failed(error);
  }
}

v1::SaveVolumeResult VolumeSaver::SaveChecked(grpc::ServerContext* context,
                                              const Admission& admission,
                                              const v1::SaveVolumeRequest& request,
                                              grpc::ServerWriter<v1::SaveVolumeResponse>* writer) {
  // Two saves to one path would mix.
  const std::unique_lock saving(saving_, std::try_to_lock);
  if (!saving) {
    throw Error(ErrorKind::kConflict, "a volume is being saved: try again when it is done");
  }
  const auto progress = [&](std::string_view stage, double fraction) {
    v1::SaveVolumeResponse event;
    event.mutable_progress()->set_stage(std::string(stage));
    event.mutable_progress()->set_fraction(fraction);
    admission.Write(*writer, event);
  };
  const auto cancelled = [&] { return context->IsCancelled(); };
  const auto volume = session_.volume().volume;
  const std::filesystem::path path = check_(request.path());
  const MemoryClaim claim = session_.loader().budget->Claim("saving", ExportBytes(*volume, path));
  const TidyBrickWork freed(session_.retired());
  v1::SaveVolumeResult result;
  result.set_size_bytes(ExportVolume(*volume, {path, request.overwrite()}, progress, cancelled));
  result.set_volume_revision(volume->revision());
  return result;
}

}  // namespace palpate
