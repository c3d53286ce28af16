// The orientation cube in a corner of the view: its faces show where the volume's sides are, and a
// click on a face looks from there.
//
// Frames: D (mm); W (mm; P of patient_axes.h where it is known); V view (x right, y up, z towards
// the viewer); U what the camera keeps upright. Points of the cube's picture: x right, y down, from
// its middle; a corner of the cube is at most 1 from it. Threads: pure functions.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/patient_axes.h"

namespace palpate::view {

struct CubeFace {
  SignedAxis direction_W;  // from the volume's middle to this side
  std::array<Eigen::Vector2d, 4> corners;
  Eigen::Vector2d middle;
  double facing = 0.0;  // 0 (edge on) to 1 (seen from straight ahead)
};

// The faces that are seen, at most three. `R_VW`: directions of W, of length 1, in V; a mirrored
// volume has a mirrored cube.
std::vector<CubeFace> SeenFaces(const Mat3& R_VW);
// The face at a point of the picture; none beside the cube.
std::optional<SignedAxis> FaceAt(const std::vector<CubeFace>& faces, const Eigen::Vector2d& point);

// A, P, L, R, S or I of a patient; otherwise "+x" to "-z".
std::string FaceText(const SignedAxis& direction_W, bool of_patient);

// The frame U in which a volume's axes are those of D that are nearest to them.
Mat3 UprightVolume(const Mat3& D_from_I, const Mat3& W_from_I);

// Where the camera's angles look from a side of the volume, while U is upright.
struct SideView {
  double azimuth_deg;
  double elevation_deg;
};
// `direction_U`: the nearest axis counts. From above, a patient's anterior is up.
SideView LookFromSide(const Vec3& direction_U, bool of_patient);

// The sides of the keys 1 to 6 in U: anterior, posterior, left, right, superior and inferior of a
// patient; front, back, left, right, top and bottom of another thing, as its viewer has them.
SignedAxis SideOfKey(int key, bool of_patient);

}  // namespace palpate::view
