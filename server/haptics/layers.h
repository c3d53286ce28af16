// Layers: several isosurfaces of one volume, felt one behind the other.
//
// Between two layers the stylus is free. Each layer holds it with a stiffness and a friction of its
// own, from both sides. Pressed harder than its pop force, a layer lets the stylus pass: inwards at
// pop_in_n, outwards at pop_out_n. Layers are in the order in which a stylus meets them from the
// side where felt densities are low.
//
// The stylus is never deeper than the layers that it has passed. An id names a layer while its
// isovalue changes, so that a layer that was passed stays passed. If layers change their order, are
// added or removed, the stylus is behind the first layers of the new order that it had all passed.
//
// Units: in the names; forces and lengths are the device's. Isovalues: normalised and felt.
// Threads: plain values.
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace palpate {

inline constexpr int kMaxLayers = 8;
// The least distance of two isovalues, in ranges of the volume: far more than rounding and the
// steps between ties, which tell on which side of a layer the stylus is.
inline constexpr double kLeastLayerGap = 1e-6;
// While isovalues glide, and for rounding.
inline constexpr double kLeastBand = 0.5e-6;

struct HapticLayer {
  int id = 1;  // 1 to kMaxLayers
  double isovalue = 0.5;
  double asked_isovalue = 0.0;  // the same in data units, as somebody gave it
  double stiffness_n_per_mm = 0.5;
  double damping_n_s_per_m = 0.0;
  double static_friction = 0.0;
  double dynamic_friction = 0.0;
  double pop_in_n = 0.0;             // 0: never
  double pop_out_n = 0.0;            // 0: never
  double viscosity_n_s_per_m = 0.0;  // drag in the space behind it
  double texture_force_n = 0.0;      // of its grain (friction.h); 0: none
  double texture_wavelength_mm = 1.0;

  bool has_friction() const {
    return static_friction > 0.0 || dynamic_friction > 0.0 || texture_force_n > 0.0;
  }
  std::uint8_t bit() const { return static_cast<std::uint8_t>(1u << (id - 1)); }
};

// By ascending isovalue, at least kLeastLayerGap apart, with different ids.
struct HapticLayers {
  std::array<HapticLayer, kMaxLayers> layer;
  int count = 0;

  std::span<const HapticLayer> all() const {
    return {layer.data(), static_cast<std::size_t>(count)};
  }
};

}  // namespace palpate
