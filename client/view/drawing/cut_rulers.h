// Places of cuts in mm of the volume, for people. A lattice's axes are nearly those of P
// (patient_axes.h); each axis has a ruler, which runs in the direction of P's axis and has P's
// zero.
//
// Frames: I (voxels), P, W (mm). Threads: pure.
#pragma once

#include <array>

#include "client/view/drawing/patient_axes.h"
#include "client/view/drawing/view_options.h"

namespace palpate::view {

struct CutRuler {
  SignedAxis along_I;     // the direction of P's axis in the lattice
  double begin_mm = 0.0;  // ends of the lattice with its layer of background
  double end_mm = 0.0;    // above begin_mm
};

// Along x, y and z of P.
std::array<CutRuler, 3> RulersOf(const AffineMap& X_PI, const Vec3i& lattice_size);

// The two faces of the crop box across a ruler, the lower one first.
std::array<double, 2> FacesOnRuler(const CropBox& crop, const CutRuler& ruler);
// Faces that are too near each other are moved apart, and all stay in the volume.
void SetFacesOnRuler(const std::array<double, 2>& faces_mm, const CutRuler& ruler, CropBox& crop);

// From the middle of the lattice to the plane, along its normal.
double DistanceOfPlane(double offset_voxels, const Vec3& normal_I, const AffineMap& X_WI,
                       const Vec3i& lattice_size);
double OffsetOfPlane(double distance_mm, const Vec3& normal_I, const AffineMap& X_WI,
                     const Vec3i& lattice_size);

}  // namespace palpate::view
