// The command line of palpate-view.
//
// Threads: plain values. Errors: Error with kInvalidArgument.
#pragma once

#include <optional>
#include <string>

#include "client/sdk/server_choice.h"
#include "client/view/scene/camera.h"
#include "client/view/scene/view_options.h"

namespace palpate::view {

// Where the camera stands at first.
struct CameraStart {
  // Beside the proxy, along the surface, so that the gap between H and V is seen; angles
  // are not used then.
  bool in_profile = false;
  double azimuth_deg = 0.0;
  double elevation_deg = 0.0;
  std::optional<double> distance_mm{};  // none: all of the volume is in view
};

// What it looks at.
enum class TargetStart { kVolume, kProxy, kPoint };

struct Options {
  client::ServerChoice server{};

  bool offscreen = false;
  std::string screenshot{};  // a file; empty: none
  int frames = 0;            // 0: not limited
  double seconds = 0.0;      // likewise
  bool wait_contact = false;
  double wait_gap_mm = 0.0;  // between SCP_H and SCP_V, at least; with wait_contact
  ImageSize size{1280, 800};
  bool panels = true;

  std::optional<CameraStart> camera{};
  TargetStart target = TargetStart::kVolume;
  Vec3 target_D = Vec3::Zero();  // of kPoint
  std::optional<Eigen::Vector2d> window{};
  SurfaceOptions surface{};
  OverlayOptions overlay{};
};

// None where all is said, as after --help; `exit_code` is then the program's.
std::optional<Options> ParseOptions(int argc, char** argv, int& exit_code);

}  // namespace palpate::view
