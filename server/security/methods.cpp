#include "server/security/methods.h"

#include <algorithm>
#include <array>

namespace palpate {
namespace {

using enum Role;
using enum CallKind;
using enum InReplay;

// For calls that need no volume.
constexpr bool kAnytime = false;

constexpr auto kRules = std::to_array<MethodRule>({
    // Viewers may see all data, and may ask how it was made.
    {"/palpate.v1.PoseService/StreamPoses", kViewer, kPoseStream, kShown, kAnytime},
    {"/palpate.v1.VolumeService/StreamVolume", kViewer, kVolumeStream, kShown},
    {"/palpate.v1.FactsService/Follow", kViewer, kFactStream, kShown, kAnytime},
    {"/palpate.v1.VolumeService/GetVolume", kViewer, kQuestion, kShown},
    {"/palpate.v1.RenderService/GetSettings", kViewer, kQuestion, kShown, kAnytime},
    {"/palpate.v1.RegistrationService/GetRegistration", kViewer, kQuestion, kShown},
    {"/palpate.v1.SeriesService/GetSeries", kViewer, kQuestion, kShown},
    {"/palpate.v1.DeviceService/GetDevice", kViewer, kQuestion, kLive, kAnytime},
    {"/palpate.v1.DeviceService/ListDevices", kViewer, kQuestion, kLive, kAnytime},
    {"/palpate.v1.RecordingService/GetRecording", kViewer, kQuestion, kLive, kAnytime},
    {"/palpate.v1.ActivityService/GetActivity", kViewer, kQuestion, kLive, kAnytime},

    // Everybody who sees a problem can stop the forces: no force is always safe.
    {"/palpate.v1.DeviceService/StopForces", kViewer, kStop, kLive, kAnytime},

    // These change what the person at the stylus feels next, within the safety stage's limits. They
    // can be undone and touch no file.
    {"/palpate.v1.RenderService/UpdateSettings", kEditor, kCall, kRefused, kAnytime},
    {"/palpate.v1.RegistrationService/UpdateRegistration", kEditor, kCall, kRefused},
    {"/palpate.v1.VolumeService/EditVolume", kEditor, kCall, kRefused},
    {"/palpate.v1.VolumeService/FilterVolume", kEditor, kTransfer, kRefused},
    {"/palpate.v1.VolumeService/UndoEdit", kEditor, kCall, kRefused},
    {"/palpate.v1.VolumeService/RedoEdit", kEditor, kCall, kRefused},
    {"/palpate.v1.VolumeService/RevertVolume", kEditor, kCall, kRefused},
    {"/palpate.v1.SeriesService/ControlSeries", kEditor, kCall, kRefused},
    {"/palpate.v1.RecordingService/Mark", kEditor, kCall, kLive},

    // The device moves a hand. A caller that enables it, disables it or sets its zero is
    // responsible for the person at the device.
    {"/palpate.v1.DeviceService/EnableForces", kOperator, kCall, kLive, kAnytime},
    {"/palpate.v1.DeviceService/DisableForces", kOperator, kCall, kLive, kAnytime},
    {"/palpate.v1.DeviceService/CalibrateDevice", kOperator, kCall, kLive, kAnytime},
    {"/palpate.v1.DeviceService/PushHand", kOperator, kCall, kRefused, kAnytime},
    {"/palpate.v1.DeviceService/LeadHand", kOperator, kHand, kLive, kAnytime},

    // These read and write files of the workstation, fill its memory and disk, or permanently put
    // another volume under the stylus.
    {"/palpate.v1.VolumeService/LoadVolume", kOperator, kTransfer, kRefused},
    {"/palpate.v1.VolumeService/UploadVolume", kOperator, kTransfer, kRefused},
    {"/palpate.v1.VolumeService/SaveVolume", kOperator, kTransfer, kLive},
    {"/palpate.v1.SeriesService/LoadSeries", kOperator, kTransfer, kRefused},
    {"/palpate.v1.RecordingService/StartRecording", kOperator, kCall, kRefused},
    {"/palpate.v1.RecordingService/StopRecording", kOperator, kCall, kLive},
    {"/palpate.v1.RecordingService/ListRecordings", kOperator, kQuestion, kLive, kAnytime},
    // Shows all viewers the past instead of the present.
    {"/palpate.v1.RecordingService/Replay", kOperator, kTransfer, kLive},

    // Ends others' calls.
    {"/palpate.v1.ActivityService/EndCaller", kAdmin, kCall, kLive, kAnytime},
});

}  // namespace

std::span<const MethodRule> MethodRules() { return kRules; }

const MethodRule* FindMethodRule(std::string_view method) {
  const auto* found = std::find_if(kRules.begin(), kRules.end(),
                                   [&](const MethodRule& rule) { return rule.method == method; });
  return found == kRules.end() ? nullptr : found;
}

}  // namespace palpate
