// Which parts of the volume are drawn, and how.
//
// Values in data units, crop in fractions of the lattice, planes in I (voxels).
// Threads: plain values.
#pragma once

#include <array>
#include <vector>

#include "client/view/drawing/value_window.h"
#include "common/geometry/geometry.h"

namespace palpate::view {

using Rgb = Eigen::Vector3f;  // 0 to 1, in screen colours

// A second, transparent isosurface.
struct Veil {
  bool shown = false;
  double isovalue = 0.0;
  Rgb color{0.45f, 0.75f, 1.0f};
  double opacity = 0.3;  // of one layer, 0 to 1
  friend bool operator==(const Veil&, const Veil&) = default;
};

// An isosurface that is felt before another one: drawn as a veil of its own colour, as clear as the
// user's veil, and as a line of this colour on slices.
struct LayerVeil {
  double isovalue = 0.0;
  Rgb color = Rgb::Ones();
  friend bool operator==(const LayerVeil&, const LayerVeil&) = default;
};
// Of the layer with this id, 1 to 8, in the picture, on the histogram and in lists.
const Rgb& LayerColor(int id);

// Shows only points between the two corners. 0 to 1 along each axis of the lattice with its layer
// of background, so 0 and 1 cut nothing.
struct CropBox {
  Vec3 min = Vec3::Zero();
  Vec3 max = Vec3::Ones();
  friend bool operator==(const CropBox&, const CropBox&) = default;
};

// Shows only points p with normal · p <= offset.
struct ClipPlane {
  bool on = false;
  Vec3 normal_I = Vec3::UnitX();  // of length 1, in voxels
  double offset_voxels = 0.0;
  friend bool operator==(const ClipPlane&, const ClipPlane&) = default;
};

// The colouring of a surface.
enum class SurfaceColoring {
  kPlain,   // color
  kHeight,  // the colour map along the lattice's z
  kSlope,   // the colour map over the gradient's magnitude; its end is half of the
            // volume's value range over the edge of a voxel
};

struct SurfaceOptions {
  bool shown = true;
  double isovalue = 0.0;
  bool free_above = false;  // material is at and below the isovalue
  Rgb color{0.87f, 0.80f, 0.70f};
  SurfaceColoring coloring = SurfaceColoring::kPlain;
  ColorMap color_map = ColorMap::kGray;
  // The ends of the colour map, for cut faces and slices.
  double window_min = 0.0;
  double window_max = 1.0;
  Veil veil{};
  // From palpated, in order from outside; the innermost one is drawn as the surface.
  std::vector<LayerVeil> layers{};
  CropBox crop{};
  std::array<ClipPlane, 2> planes{};
  // Where crop box and planes cut material, the cut faces show the values.
  bool caps = true;
  friend bool operator==(const SurfaceOptions&, const SurfaceOptions&) = default;
};

// Objects drawn over the surface.
struct OverlayOptions {
  bool points = true;  // HIP, SCP_H, SCP_V
  bool force = true;   // an arrow from SCP_H
  bool stylus = true;
  bool haptic_surface = false;  // wireframe of H near the proxy
  double haptic_surface_radius_voxels = 5.0;
  bool box = true;      // edges of the lattice
  bool letters = true;  // of the patient's axes, beside the box and at the slices' edges
};

}  // namespace palpate::view
