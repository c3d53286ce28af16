#include "server/security/methods.h"

#include <algorithm>
#include <array>

namespace palpate {
namespace {

using enum Role;
using enum CallKind;

constexpr auto kRules = std::to_array<MethodRule>({
    // Who may watch may see all there is to see, and ask how it was made.
    {"/palpate.v1.PoseService/StreamPoses", kViewer, kPoseStream},
    {"/palpate.v1.VolumeService/StreamVolume", kViewer, kVolumeStream},
    {"/palpate.v1.VolumeService/GetVolume", kViewer, kCall},
    {"/palpate.v1.RenderService/GetSettings", kViewer, kCall},
    {"/palpate.v1.RegistrationService/GetRegistration", kViewer, kCall},
    {"/palpate.v1.SeriesService/GetSeries", kViewer, kCall},
    {"/palpate.v1.DeviceService/GetDevice", kViewer, kCall},
    {"/palpate.v1.DeviceService/ListDevices", kViewer, kCall},
    {"/palpate.v1.RecordingService/GetRecording", kViewer, kCall},

    // Whoever sees that something goes wrong can end it: no force is always safe.
    {"/palpate.v1.DeviceService/StopForces", kViewer, kStop},

    // What the person at the stylus feels next, within the safety stage's limits. It
    // can be undone, and touches no file.
    {"/palpate.v1.RenderService/UpdateSettings", kEditor, kCall},
    {"/palpate.v1.RegistrationService/UpdateRegistration", kEditor, kCall},
    {"/palpate.v1.VolumeService/EditVolume", kEditor, kCall},
    {"/palpate.v1.VolumeService/FilterVolume", kEditor, kTransfer},
    {"/palpate.v1.VolumeService/UndoEdit", kEditor, kCall},
    {"/palpate.v1.VolumeService/RedoEdit", kEditor, kCall},
    {"/palpate.v1.VolumeService/RevertVolume", kEditor, kCall},
    {"/palpate.v1.SeriesService/ControlSeries", kEditor, kCall},
    {"/palpate.v1.RecordingService/Mark", kEditor, kCall},

    // The device moves a hand: whoever enables it, disables it or sets its zero
    // answers for the person at it.
    {"/palpate.v1.DeviceService/EnableForces", kOperator, kCall},
    {"/palpate.v1.DeviceService/DisableForces", kOperator, kCall},
    {"/palpate.v1.DeviceService/CalibrateDevice", kOperator, kCall},

    // Reads and writes files of the workstation, fills its memory and disk, or puts
    // another volume under the stylus, for good.
    {"/palpate.v1.VolumeService/LoadVolume", kOperator, kTransfer},
    {"/palpate.v1.VolumeService/UploadVolume", kOperator, kTransfer},
    {"/palpate.v1.VolumeService/SaveVolume", kOperator, kTransfer},
    {"/palpate.v1.SeriesService/LoadSeries", kOperator, kTransfer},
    {"/palpate.v1.RecordingService/StartRecording", kOperator, kCall},
    {"/palpate.v1.RecordingService/StopRecording", kOperator, kCall},
    // Shows all viewers another time than now.
    {"/palpate.v1.RecordingService/Replay", kOperator, kTransfer},
    // Nothing is left to the admin alone yet: identities are changed in files.
});

}  // namespace

std::span<const MethodRule> MethodRules() { return kRules; }

const MethodRule* FindMethodRule(std::string_view method) {
  const auto* found = std::find_if(kRules.begin(), kRules.end(),
                                   [&](const MethodRule& rule) { return rule.method == method; });
  return found == kRules.end() ? nullptr : found;
}

}  // namespace palpate
