// Where a session's volume lies, and where the patient faces.
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "common/error/error.h"
#include "server/session/session.h"

namespace palpate {

VolumePlace Session::PlaceLoaded(const LoadRequest& request, VolumeMetadata& metadata) const {
  const std::optional<double>& scale = request.device_mm_per_volume_mm;
  std::optional<VolumePlace> stored;
  if (registration_store_) {
    stored = registration_store_->Find(metadata);
    const std::string lost = registration_store_->WhyLost(metadata);
    if (!lost.empty()) metadata.warnings.push_back(lost);
  }
  if (!stored) return FitToWorkspace(metadata, device_, scale);
  return Apply({.device_mm_per_volume_mm = scale}, metadata, device_, *stored);
}

VolumeState Session::Move(const std::function<VolumePlace(const VolumeState&)>& change,
                          const std::optional<std::uint64_t>& expected_revision,
                          const std::optional<PatientFacing>& facing) {
  const std::lock_guard lock(mutex_);
  RequireNoReplay();
  RequireRevision(expected_revision);
  const VolumeMetadata& metadata = volume_->metadata();
  if (facing &&
      facing->loaded_revision.value_or(volume_->loaded_revision()) != volume_->loaded_revision()) {
    throw Error(ErrorKind::kConflict,
                "another volume has been loaded: look at it, and say where it faces");
  }
  if (facing && !metadata.patient_axes.empty()) {
    throw Error(ErrorKind::kFailedPrecondition,
                "the file states its orientation: where the patient faces cannot be answered");
  }
  std::string axes = facing ? PatientAxesOf(*facing) : patient_axes_;
  registration_ = change(VolumeLocked());
  const AffineMap before = std::exchange(X_DI_, registration_.X_DW * metadata.WorldFromIndex());
  // An answer alone is not felt, and leaves a fitted place to be fitted anew.
  const bool moves = !facing || X_DI_ != before;
  // After a reshape, the registration is not stored: it would replace the registration of the
  // file's lattice.
  if (registration_store_ && moves && !is_reshaped_) {
    registration_store_->Keep(metadata, registration_);
  }
  if (registration_store_ && facing) registration_store_->KeepAxes(voxels_name_, axes);
  patient_axes_ = std::move(axes);
  if (moves) ++geometry_revision_;
  ++settings_revision_;
  PublishLocked();
  VolumeState state = VolumeLocked();
  if (moves && is_reshaped_) {
    state.move_problem =
        "the volume has another lattice than its file: save it, and load that file";
  }
  return state;
}

}  // namespace palpate
