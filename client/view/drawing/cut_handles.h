// Handles of crop box and clip planes: an arrow on each face of the box, and on each plane an arrow
// and a disc whose rim turns the plane. What the pointer hits, and what a drag makes of the cuts.
// Rulers say where the cuts are.
//
// Frames: D (mm), I (voxels); pixels from the picture's upper left corner.
// Threads: plain values and pure functions.
#pragma once

#include <array>
#include <optional>
#include <tuple>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/overlay.h"
#include "client/view/drawing/patient_axes.h"
#include "client/view/drawing/view_options.h"

namespace palpate::view {

// All that is cut away.
struct Cuts {
  CropBox crop{};
  decltype(SurfaceOptions::planes) planes{};
  friend bool operator==(const Cuts&, const Cuts&) = default;
};
inline constexpr std::size_t kClipPlanes = std::tuple_size_v<decltype(Cuts::planes)>;

Cuts CutsOf(const SurfaceOptions& surface);
void SetCuts(const Cuts& cuts, SurfaceOptions& surface);

// The least share of the volume that stays between two faces of the crop box.
inline constexpr double kLeastCrop = 0.01;

// A point of the lattice with its layer of background, from fractions of it.
Vec3 PointOfFractions(const Vec3& fractions, const Vec3i& lattice_size);
// The offsets at which a plane of this normal cuts nothing of the lattice (the second) and
// everything (the first); in voxels.
std::array<double, 2> OffsetRange(const Vec3& normal_I, const Vec3i& lattice_size);

struct CutScene {
  Cuts cuts{};
  AffineMap X_DI{};
  Vec3i lattice_size = Vec3i::Zero();
  // A plane's handle is at the point of the plane that is nearest to this one.
  std::array<Vec3, kClipPlanes> pivots_I{};
  // Of the handles' size: 1 on screens of about 100 pixels per inch.
  double scale = 1.0;
};

struct CutHandle {
  enum class Kind {
    kFace,   // of the crop box
    kPlane,  // moves a plane along its normal
    kRim,    // turns a plane
  };
  Kind kind = Kind::kFace;
  std::size_t number =
      0;  // of a face: 2 · axis, and one more for the greater end; else the plane's
  friend bool operator==(const CutHandle&, const CutHandle&) = default;
};

// The handle under the pointer, the nearest of several. An arrow that points to the eye is none.
std::optional<CutHandle> HandleAt(const CutScene& scene, const Projection& projection,
                                  const Eigen::Vector2d& at_px);

// A drag of a handle. The place where the pointer took it stays under the pointer, as far as the
// cuts can follow: faces stay in the volume and apart, planes within the volume.
class CutDrag {
 public:
  CutDrag(const CutHandle& handle, const CutScene& scene, const Projection& projection,
          const Eigen::Vector2d& at_px);

  const CutHandle& handle() const { return handle_; }
  // The cuts and pivots with the pointer here.
  CutScene At(const Projection& projection, const Eigen::Vector2d& at_px) const;

 private:
  Vec3 DirectionAt(const Projection& projection, const Eigen::Vector2d& at_px) const;
  void Turn(const Vec3& direction_D, CutScene& scene) const;

  CutHandle handle_;
  CutScene begun_;
  Vec3 origin_D_ = Vec3::Zero();
  Vec3 along_D_ = Vec3::UnitX();  // of length 1: of the arrow
  double taken_mm_ = 0.0;         // along the arrow
  // Of a rim: a sphere about the origin, on which the taken point moves.
  double radius_mm_ = 0.0;
  Vec3 taken_D_ = Vec3::UnitX();                         // direction from the origin
  Eigen::Vector2d beside_px_ = Eigen::Vector2d::Zero();  // of the pointer from the rim
  bool is_near_ = true;                                  // on the side of the eye
};

// Adds the edges of the crop box.
void AddCropBox(const CutScene& scene, Overlay& overlay);
// Adds all handles; `lit`: the one that the pointer has.
void AddCutHandles(const CutScene& scene, const std::optional<CutHandle>& lit,
                   const Projection& projection, Overlay& overlay);

// Places of cuts in mm of the volume, for people. A lattice's axes are nearly those of P
// (patient_axes.h); each axis has a ruler, which runs in the direction of P's axis and has P's
// zero.
//
// Frames: I (voxels), P, W (mm). Threads: pure.
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
