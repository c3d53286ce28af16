// One haptic update: from the stylus's position to the proxy and the force.
//
//   HIP -> proxy (with friction) -> spring -> shading -> damper and viscosity
//       -> passivity control -> magnet, fading force of a pop -> force
//
// Penetrability: if the spring exceeds a layer's pop force, the proxy changes to the other side of
// its H. It moves on towards the HIP until it meets H again, now from within, or the H of the next
// layer. At most one layer is passed in a step. The force of that moment fades out over kPopFadeS.
// Without layers, the one surface is a layer with pop_force_n both ways.
//
// Slack: if the proxy changes from one layer to a stiffer one, the spring of that would climb by
// itself. It begins at the force of that moment instead: its depth counts from `slack_mm` on, which
// only ever falls until the contact ends. So a spring's origin moves only where the force stays the
// same, which gives the hand no energy. A softer layer takes over at its own force, and the rest
// fades.
//
// Frame: D (mm, N). Threads: pure; one thread per state.
// Real-time: no allocation, no locks; bounded by the bounds of the proxy.
#pragma once

#include <memory>

#include "server/haptics/friction.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/passivity.h"
#include "server/haptics/proxy.h"
#include "server/haptics/settings.h"
#include "server/haptics/visual_proxy.h"

namespace palpate {

// While the proxy is brought out of the object, it is not moved to a surface that would need more
// than this force.
inline constexpr double kEjectForceLimitN = 3.3;

inline constexpr double kPopFadeS = 0.03;

// The state that the next step depends on, besides its input. server/servo/servo_memory.h lists it
// member by member.
struct RendererMemory {
  Proxy proxy;
  bool has_hip = false;
  Vec3 p_DHip_mm = Vec3::Zero();          // the last accepted position
  Vec3 p_DLastHip_mm = Vec3::Zero();      // the position of the last step
  Vec3 velocity_mm_per_s = Vec3::Zero();  // of the HIP, low-passed
  FrictionState friction;
  std::uint8_t passed = 0;            // bits of the layers that were passed (HapticLayer::bit)
  double rejected_s = 0.0;            // time since the last accepted HIP
  double spring_mj = 0.0;             // energy of the spring in the last step
  Vec3 felt_D_n = Vec3::Zero();       // the last force without the magnet
  Vec3 pop_force_D_n = Vec3::Zero();  // the force that the last pop took away
  double pop_fade = 0.0;              // the share of pop_force_D_n that is left
  PassivityState passivity;
  Vec3 limited_D_n = Vec3::Zero();    // part of the last force: what the control let pass
  Vec3 by_design_D_n = Vec3::Zero();  // the other part of the last force: magnet and pop
  int touched = 0;                    // id of the layer in contact; negative: from within; 0: none
  double slack_mm = 0.0;
  bool layered = false;  // the last step was on layers
};

struct RendererState : RendererMemory {
  // The same for all steps:
  PassivityDevice device;
  bool glides = false;  // isovalues change at a bounded rate (isovalue_glide.h)
  CellCache cache;
  // Not within: two caches would fill a small stack.
  std::unique_ptr<CellCache> magnet_cache = std::make_unique<CellCache>();
};

struct HapticOutput {
  Vec3 p_DHip_mm = Vec3::Zero();  // the HIP used; the last good one if the input was invalid
  ProxyStep proxy;
  Vec3 spring_D_n = Vec3::Zero();  // k (SCP_H - HIP), less the slack
  Vec3 force_D_n = Vec3::Zero();   // with damping and effects; not limited yet
  // The H in contact; without contact the next one inwards, or the last one.
  double isovalue = 0.0;                  // normalised and felt
  FreeSide free_side = FreeSide::kBelow;  // of it
  int layers_passed = 0;                  // 0 without layers
  int contact_layer = 0;                  // its id; 0: no contact, or no layers
  bool popped = false;                    // the pop is in this step
  bool input_rejected = false;
};

HapticOutput StepRenderer(const HapticSurface& surface, const HapticSettings& settings,
                          const Vec3& p_DHip_mm, double dt_s, RendererState& state) noexcept;

// Takes the position for the next step. Returns false if it is none; the last good one stays.
bool TrackHip(const Vec3& p_DHip_mm, double dt_s, RendererState& state) noexcept;

// SCP_V of the last step, which gave `output`. No force depends on it, so a step does without.
VisualProxy VisualProxyOf(const HapticSurface& surface, const HapticOutput& output,
                          RendererState& state) noexcept;

// A step in which nothing is felt: the proxy is at the HIP. The next StepRenderer starts anew
// there.
HapticOutput SuspendRenderer(const Vec3& p_DHip_mm, double dt_s, RendererState& state) noexcept;

// Nothing of what was touched is left.
void ForgetContact(RendererState& state) noexcept;

// Call it after each step if the force is limited further before it is written, so that the
// passivity control accounts for the force that the hand gets.
void TellWrittenForce(const Vec3& written_D_n, RendererState& state) noexcept;

}  // namespace palpate
