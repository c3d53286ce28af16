// The command line of palpate-view.
//
// Threads: plain values. Errors: arguments::UsageError.
#pragma once

#include <optional>
#include <string>

#include "client/sdk/server_choice.h"
#include "client/view/drawing/camera.h"
#include "client/view/drawing/patient_axes.h"
#include "client/view/drawing/view_options.h"

namespace palpate::view {

// The camera's first position.
struct CameraStart {
  // Beside the proxy and along the surface, so that the gap between H and V is visible. The angles
  // are then ignored.
  bool in_profile = false;
  // The angles are of the upright patient, not of the device.
  bool of_patient = false;
  double azimuth_deg = 0.0;
  double elevation_deg = 0.0;
  std::optional<double> distance_mm{};  // none: the whole volume is in view
};

// The point that the camera looks at.
enum class TargetStart { kVolume, kProxy, kPoint };

struct Options {
  client::ServerChoice server{};

  bool offscreen = false;
  std::string screenshot{};  // a file name; empty: none
  bool overwrite = false;    // of the screenshot
  int frames = 0;            // 0: no limit
  double seconds = 0.0;      // 0: no limit
  bool wait_contact = false;
  double wait_gap_mm = 0.0;  // the least distance between SCP_H and SCP_V; with wait_contact
  ImageSize size{1280, 800};
  bool panels = true;
  int graphics_memory_mib = 1024;  // the most for the volume

  std::optional<CameraStart> camera{};
  TargetStart target = TargetStart::kVolume;
  Vec3 target_D = Vec3::Zero();  // for kPoint
  std::optional<Eigen::Vector2d> window{};
  SurfaceOptions surface{};
  OverlayOptions overlay{};
  std::optional<SliceSide> slice_side{};  // none: as remembered
};

// Returns none if the program is done, as after --help.
std::optional<Options> ParseOptions(int argc, char** argv);

}  // namespace palpate::view
