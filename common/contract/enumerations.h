// Written by proto/generate from palpate/v1/*.proto: change those.
#pragma once

#include "common/contract/enumeration.h"

namespace palpate {

// What the safety stage does with the forces.
enum class ForceState : std::uint8_t {
  kUnknown,
  // Not enabled, or disabled by the operator.
  kOff,
  // Enabled; the limit rises to the full limit.
  kRampIn,
  kOn,
  // Ramped out while a condition is not met; they come back by themselves.
  kHeld,
  // Cut off. On hardware, until they are enabled again.
  kFault,
  // Cut off by the emergency stop, until they are enabled again.
  kStopped,
};
template <>
inline constexpr std::array<Enumerator, 7> kEnumerators<ForceState> = {{
    {"unknown", "forces unknown", ""},
    {"off", "forces off", ""},
    {"ramp-in", "forces are coming on", ""},
    {"on", "forces on", ""},
    {"held", "forces held back", ""},
    {"fault", "forces off after a fault", ""},
    {"stopped", "forces stopped", ""},
}};

// The reason of the state of the forces.
enum class ForceReason : std::uint8_t {
  kUnknown,
  kNone,
  // Off: never enabled, or disabled.
  kOperator,
  // Held: the stylus rests in its holder.
  kDocked,
  // Held: the position has no meaning yet.
  kUncalibrated,
  // Held: readings are late.
  kStale,
  // Held: the servo missed its deadlines.
  kDeadlines,
  // Fault: the device is gone or broken.
  kDevice,
  // Fault: the position or the orientation is invalid.
  kPosition,
  // Fault: the force or the torque is not finite.
  kForce,
  // Fault: the stylus moves or turns faster than a hand.
  kSpeed,
  // Stopped: by a call.
  kStopCall,
  // Stopped: by the stylus's buttons.
  kStopButton,
  // Held: a recording is replayed to viewers. Forces that are enabled meanwhile come at its
  // end.
  kReplay,
};
template <>
inline constexpr std::array<Enumerator, 14> kEnumerators<ForceReason> = {{
    {"unknown", "", ""},
    {"none", "", ""},
    {"operator", "not enabled", "'palpate device enable' lets them ramp in"},
    {"docked", "the stylus rests in its holder", "take it out"},
    {"uncalibrated", "the stylus's position is not known yet", "'palpate device info' says what to do"},
    {"stale", "readings of the device are late", "check its cable, and 'palpate device test'"},
    {"deadlines", "the haptic loop misses ticks", "see the warnings of 'palpate info'"},
    {"device", "the device is gone or broken", "check its cable and power, and 'palpate device info'"},
    {"position", "the device gave a position or orientation that is none", "check it with 'palpate device test', then enable forces again"},
    {"force", "a force or torque came out that is no number", "change the settings or load the volume again, then enable forces again"},
    {"speed", "the stylus moved or turned faster than a hand", "hold it, then enable forces again"},
    {"stop-call", "emergency stop", "'palpate device enable' ends it"},
    {"stop-button", "emergency stop by the stylus's buttons", "let them go, then 'palpate device enable'"},
    {"replay", "until the replay ends", ""},
}};

// The operator's command that the safety stage got in a tick.
enum class ForceCommand : std::uint8_t {
  kUnknown,
  kNone,
  kEnable,
  kDisable,
  kStop,
};
template <>
inline constexpr std::array<Enumerator, 5> kEnumerators<ForceCommand> = {{
    {"unknown", "", ""},
    {"none", "", ""},
    {"enable", "", ""},
    {"disable", "", ""},
    {"stop", "", ""},
}};

// The device's reading in a tick.
enum class DeviceStatus : std::uint8_t {
  kUnknown,
  kOk,
  // No new reading came for longer than its period; the state is the last good one. Also after
  // zero force was written because the servo was silent, until the servo writes zero: the old
  // force must not come back in one step.
  kStale,
  // The device is gone or broken; forces must stay off.
  kFault,
};
template <>
inline constexpr std::array<Enumerator, 4> kEnumerators<DeviceStatus> = {{
    {"unknown", "", ""},
    {"ok", "", ""},
    {"stale", "", ""},
    {"fault", "", ""},
}};

// Whether the device is there.
enum class DeviceConnection : std::uint8_t {
  kUnknown,
  // Not found, or cannot be opened. The daemon keeps looking for it.
  kAbsent,
  // Found, and being set up.
  kConnecting,
  // It sends its position.
  kStreaming,
};
template <>
inline constexpr std::array<Enumerator, 4> kEnumerators<DeviceConnection> = {{
    {"unknown", "", ""},
    {"absent", "", ""},
    {"connecting", "", ""},
    {"streaming", "", ""},
}};

// How much of a device's behaviour has been verified on hardware. Each level includes those
// before.
enum class VerificationLevel : std::uint8_t {
  kUnknown,
  kNone,
  kEnumerated,
  kIdentified,
  kStateRead,
  kForceVerified,
  kSimulated,
};
template <>
inline constexpr std::array<Enumerator, 7> kEnumerators<VerificationLevel> = {{
    {"unknown", "", ""},
    {"none", "nothing of it was seen on hardware", ""},
    {"enumerated", "it was found and opened on hardware, no more", ""},
    {"identified", "it told who it is on hardware, no more", ""},
    {"state-read", "positions and buttons were right on hardware, forces not tried", ""},
    {"force-verified", "forces had the right direction and size on hardware", ""},
    {"simulated", "there is no hardware to verify", ""},
}};

// What a client may do. Each role may do everything that the earlier roles may do.
enum class Role : std::uint8_t {
  kUnknown,
  // Watches.
  kViewer,
  // Changes settings, voxels and the volume's place.
  kEditor,
  // Drives the device; loads, saves and records.
  kOperator,
  // May do everything.
  kAdmin,
};
template <>
inline constexpr std::array<Enumerator, 5> kEnumerators<Role> = {{
    {"unknown", "", ""},
    {"viewer", "", ""},
    {"editor", "", ""},
    {"operator", "", ""},
    {"admin", "", ""},
}};

// Frame of an edit's positions and lengths.
enum class EditFrame : std::uint8_t {
  kUnknown,
  // mm; LPS if the file states an orientation. The description's world_from_index maps voxel
  // indices to this frame.
  kWorld,
  // Voxels; voxel (0, 0, 0) is the first of the file.
  kIndex,
};
template <>
inline constexpr std::array<Enumerator, 3> kEnumerators<EditFrame> = {{
    {"unknown", "", ""},
    {"world", "", ""},
    {"index", "", ""},
}};

// What an edit makes of a value v, with the weight w of its voxel.
enum class EditOperation : std::uint8_t {
  kUnknown,
  // v + w·value
  kAdd,
  // v - w·value
  kSubtract,
  // the value where w is 1; between v and the value where w is less
  kSet,
  // towards the mean of the 27 voxels around, by w·strength; not for a block
  kSmooth,
  // v + w·strength·(value - v)
  kPaint,
};
template <>
inline constexpr std::array<Enumerator, 6> kEnumerators<EditOperation> = {{
    {"unknown", "", ""},
    {"add", "", ""},
    {"subtract", "", ""},
    {"set", "", ""},
    {"smooth", "", ""},
    {"paint", "", ""},
}};

// OpenVDB's filters of this name (openvdb::tools::Filter, openvdb::tools::LevelSetFilter).
enum class FilterKind : std::uint8_t {
  kUnknown,
  // four means one after the other
  kGaussian,
  // the mean of the (2·width + 1)³ voxels around each voxel
  kMean,
  // the median of the same voxels; slow for a width above 2
  kMedian,
  // The last three kinds filter whole volumes. If somebody edits in the meantime, they start
  // again, with at most three attempts. for level sets: moves the surface outwards by
  // distance_mm
  kOffset,
  // for level sets: mean-curvature flow, which smooths the surface
  kMeanCurvature,
  // to another spacing: interpolates between the eight voxels around each new voxel
  // (openvdb::tools::BoxSampler). The surface of a level set is computed anew, with the same
  // number of voxels in its band.
  kResample,
};
template <>
inline constexpr std::array<Enumerator, 7> kEnumerators<FilterKind> = {{
    {"unknown", "", ""},
    {"gaussian", "smooths noise: four means one after the other", ""},
    {"mean", "the mean of the voxels around each voxel", ""},
    {"median", "removes single wrong voxels and keeps edges; slow above a width of 2", ""},
    {"offset", "level sets: moves the surface outwards, or inwards by a negative distance", ""},
    {"mean-curvature", "level sets: smooths the surface, the more the stronger it curves", ""},
    {"resample", "another spacing of the voxels, for the whole volume", ""},
}};

// Tetrahedral decomposition of a cell.
enum class DecompositionMethod : std::uint8_t {
  kUnknown,
  // 24 tetrahedra around face and cell centres; does not keep topology.
  kBcc,
  // Topology-preserving, corrected; the default.
  kTpbcc,
};
template <>
inline constexpr std::array<Enumerator, 3> kEnumerators<DecompositionMethod> = {{
    {"unknown", "", ""},
    {"bcc", "", ""},
    {"tpbcc", "", ""},
}};

// Side of the isosurface on which the stylus is free.
enum class FreeSide : std::uint8_t {
  kUnknown,
  // Where densities are below the isovalue; the default.
  kBelow,
  // Where densities are above the isovalue: a cavity is felt from the inside.
  kAbove,
};
template <>
inline constexpr std::array<Enumerator, 3> kEnumerators<FreeSide> = {{
    {"unknown", "", ""},
    {"below", "", ""},
    {"above", "", ""},
}};

enum class VoxelType : std::uint8_t {
  kUnknown,
  kInt8,
  kUint8,
  kInt16,
  kUint16,
  kInt32,
  kUint32,
  kFloat32,
  kFloat64,
};
template <>
inline constexpr std::array<Enumerator, 9> kEnumerators<VoxelType> = {{
    {"unknown", "", ""},
    {"int8", "", ""},
    {"uint8", "", ""},
    {"int16", "", ""},
    {"uint16", "", ""},
    {"int32", "", ""},
    {"uint32", "", ""},
    {"float32", "", ""},
    {"float64", "", ""},
}};

// State of the proxy (SCP_H).
enum class ProxyMode : std::uint8_t {
  kUnknown,
  // In free space; SCP_H follows HIP, no force.
  kFree,
  // Held by the haptic isosurface H.
  kConstrained,
  // The surface moved over the proxy, and the proxy is being moved out.
  kEjecting,
  // Forces are off because of a fault.
  kFault,
  // Forces are off while the stylus moves the volume, or a recording is played.
  kSuspended,
  // The stylus is inside the object, too deep to be moved out: a new isovalue, edit or volume
  // put the surface over it. Nothing is felt until the stylus is pulled out.
  kInside,
};
template <>
inline constexpr std::array<Enumerator, 7> kEnumerators<ProxyMode> = {{
    {"unknown", "", ""},
    {"free", "in free space", ""},
    {"constrained", "held by the surface", ""},
    {"ejecting", "the surface moved over the tip, the proxy is being moved out", ""},
    {"fault", "nothing is felt after a fault", ""},
    {"suspended", "nothing is felt: the volume is moved", ""},
    {"inside", "nothing is felt: the stylus is inside the surface, pull it out", ""},
}};

}  // namespace palpate
