// The surface that the stylus feels: a volume, an isovalue, the side from which it is felt, and the
// volume's place.
//
// Free space is where the felt density is at most `isovalue`, and at least `lower`. Together, they
// bound a band between two layers. Without layers, only `isovalue` bounds free space,
// or, once the stylus has popped through, only `lower`.
//
// Densities are normalised over the volume's range. To feel H from the side above τ, densities and
// isovalue change their sign; these are the "felt" values. On either side, material lies above the
// felt isovalue, and H is the same. The padding keeps its density. The space beyond the padding
// belongs to the side below τ; around a level set, it belongs to the side above τ.
//
// Frames: I voxel index, L index of the lattice that H is made of (lattice.h), D device (mm).
// Distances, projections and normals are taken in D, whatever spacing, shear or mirror the volume's
// transform has.
// Threads: plain values. Ownership: borrows the snapshot and the layers.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "server/haptics/settings.h"
#include "server/volume/snapshot/lattice.h"

namespace palpate {

inline constexpr int kMaxLayers = 8;
// The least distance of two isovalues, in ranges of the volume: far more than rounding and the
// steps between ties, which tell on which side of a layer the stylus is.
inline constexpr double kLeastLayerGap = 1e-6;
// While isovalues glide, and for rounding.
inline constexpr double kLeastBand = 0.5e-6;

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

inline constexpr double kUnbounded = std::numeric_limits<double>::infinity();

// The bound of free space that a point rests on.
enum class Contact : std::uint8_t { kNone, kUpper, kLower };

constexpr FreeSide OtherSide(FreeSide side) {
  return side == FreeSide::kBelow ? FreeSide::kAbove : FreeSide::kBelow;
}

struct HapticSurface {
  const VolumeSnapshot* volume = nullptr;
  Lattice lattice;             // of `volume`
  double isovalue = 0.5;       // τ, normalised and felt; kUnbounded: none
  double lower = -kUnbounded;  // another τ, normalised and felt
  // The isosurfaces in place of `isovalue`; null: only that one.
  const HapticLayers* layers = nullptr;
  FreeSide free_side = FreeSide::kBelow;
  DecompositionMethod method = DecompositionMethod::kTpbcc;
  AffineMap X_DI, X_ID;
  AffineMap X_DL, X_LD;
  // Changes whenever anything changes except isovalues, the side, the refinement and voxels. The
  // volume's revisions say which voxels changed.
  std::uint64_t geometry_revision = 0;

  // Shortest edge of a voxel in D. Tolerances are relative to it.
  double voxel_mm = 1.0;
  double longest_voxel_mm = 1.0;

  double sign() const { return free_side == FreeSide::kBelow ? 1.0 : -1.0; }
  // The felt density of a voxel, ties resolved.
  double ResolvedVertex(const Vec3i& voxel) const noexcept {
    return sign() * volume->ResolvedVertex(voxel);
  }
  // Converts densities to felt ones, and back.
  CellDensities Felt(CellDensities densities) const noexcept {
    if (free_side == FreeSide::kBelow) return densities;
    for (double& density : densities) density = -density;
    return densities;
  }
  // Whether a felt density is that of free space.
  bool Holds(double density) const { return density <= isovalue && density >= lower; }
  // The felt density beyond the padded lattice. Of a density's volume it is beyond every τ.
  double DensityOutside() const {
    if (volume->metadata().is_level_set) return sign() * volume->BackgroundDensity();
    if (!IsLowOutside()) return 1.0;
    return lower == -kUnbounded ? 0.0 : -1.0;
  }
  bool IsFreeOutside() const {
    return IsLowOutside() ? lower == -kUnbounded : isovalue == kUnbounded;
  }
  // The same H, of a surface without a lower bound, from its other side.
  HapticSurface Flipped() const {
    HapticSurface other = *this;
    other.free_side = OtherSide(free_side);
    other.isovalue = -isovalue;
    return other;
  }
  // One of the two bounds alone, on the side that makes it the upper one.
  HapticSurface Facing(Contact bound) const {
    HapticSurface facing = bound == Contact::kLower ? Flipped() : *this;
    if (bound == Contact::kLower) facing.isovalue = -lower;
    facing.lower = -kUnbounded;
    return facing;
  }
  // The same volume with H made of cells of another size.
  void Refine(int refinement) noexcept {
    lattice = Lattice(*volume, refinement);
    X_DL = lattice.OnLattice(X_DI);
    X_LD = {refinement * X_ID.linear, lattice.FromVoxels(X_ID.translation)};
  }

 private:
  bool IsLowOutside() const {
    return (free_side == FreeSide::kBelow) != volume->metadata().is_level_set;
  }
};

inline HapticSurface MakeHapticSurface(const VolumeSnapshot& volume, const AffineMap& X_DI,
                                       double isovalue, DecompositionMethod method,
                                       std::uint64_t geometry_revision,
                                       FreeSide free_side = FreeSide::kBelow, int refinement = 1) {
  HapticSurface surface;
  surface.volume = &volume;
  surface.free_side = free_side;
  surface.isovalue = surface.sign() * isovalue;
  surface.method = method;
  surface.X_DI = X_DI;
  surface.X_ID = X_DI.Inverse();
  surface.Refine(refinement);
  surface.geometry_revision = geometry_revision;
  surface.voxel_mm = X_DI.linear.colwise().norm().minCoeff();
  surface.longest_voxel_mm = X_DI.linear.colwise().norm().maxCoeff();
  return surface;
}

}  // namespace palpate
