#include "client/view/viewer/options.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <sstream>
#include <vector>

#include "client/program/server_options.h"
#include "common/arguments/arguments.h"

namespace palpate::view {
namespace {

using Text = std::optional<std::string>;

// Options that stay texts while the command line is parsed.
struct Texts {
  Text size;
  Text camera;
  Text target;
  Text veil;
  Text window;
  Text color;
  std::string color_map;
  std::string coloring;
  Text crop;
  bool no_box = false;
  bool no_letters = false;
  bool neurological = false;
  bool no_stylus = false;
  bool no_overlay = false;
  bool panels = false;
};

[[noreturn]] void RefuseOption(const std::string& name, const std::string& text, const char* form) {
  throw arguments::UsageError(fmt::format("{} cannot be '{}': give {}", name, text, form));
}

// Parses `least` to `most` numbers such as "1,-2.5,3". Returns an empty list for any other text.
std::vector<double> Numbers(const std::string& text, std::size_t least, std::size_t most) {
  std::vector<double> numbers;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    const std::optional<double> number = arguments::FiniteNumber(part);
    if (!number) return {};
    numbers.push_back(*number);
  }
  if (numbers.size() < least || numbers.size() > most) return {};
  return numbers;
}

bool Within(const std::vector<double>& numbers, double least, double most) {
  return !numbers.empty() && std::all_of(numbers.begin(), numbers.end(), [&](double number) {
    return number >= least && number <= most;
  });
}

void TakeSize(const Text& text, Options& options) {
  if (!text) return;
  int width = 0;
  int height = 0;
  char rest = 0;
  if (std::sscanf(text->c_str(), "%5dx%5d%c", &width, &height, &rest) != 2 || width < 16 ||
      height < 16 || width > 8192 || height > 8192) {
    RefuseOption("--size", *text, "WIDTHxHEIGHT, each 16 to 8192 pixels");
  }
  options.size = {width, height};
}

void TakeCamera(const Text& text, Options& options) {
  if (!text) return;
  if (text->starts_with("profile,")) {
    const std::vector<double> n = Numbers(text->substr(8), 1, 1);
    if (n.empty() || n[0] <= 0.0) RefuseOption("--camera", *text, "profile,DISTANCE in mm");
    options.camera = CameraStart{.in_profile = true, .distance_mm = n[0]};
    options.target = TargetStart::kProxy;
    return;
  }
  for (const PatientView& view : kPatientViews) {
    if (text != view.name) continue;
    options.camera = CameraStart{
        .of_patient = true, .azimuth_deg = view.azimuth_deg, .elevation_deg = view.elevation_deg};
    return;
  }
  const std::vector<double> n = Numbers(*text, 2, 3);
  if (n.empty() || std::abs(n[1]) > 89.0 || (n.size() == 3 && n[2] <= 0.0)) {
    RefuseOption("--camera", *text,
                 "anterior, posterior, left, right, superior or inferior; or "
                 "AZIMUTH,ELEVATION[,DISTANCE]: degrees, the second -89 to 89, and mm; or "
                 "profile,DISTANCE");
  }
  options.camera = CameraStart{.azimuth_deg = n[0], .elevation_deg = n[1]};
  if (n.size() == 3) options.camera->distance_mm = n[2];
}

void TakeTarget(const Text& text, Options& options) {
  if (!text || text == "volume") return;
  if (text == "scp") {
    options.target = TargetStart::kProxy;
    return;
  }
  const std::vector<double> n = Numbers(*text, 3, 3);
  if (n.empty()) RefuseOption("--target", *text, "X,Y,Z in mm of the device, scp, or volume");
  options.target = TargetStart::kPoint;
  options.target_D = {n[0], n[1], n[2]};
}

void TakeVeil(const Text& text, Options& options) {
  if (!text) return;
  const std::vector<double> n = Numbers(*text, 1, 2);
  if (n.empty() || (n.size() == 2 && (n[1] <= 0.0 || n[1] > 1.0))) {
    RefuseOption("--veil", *text, "ISOVALUE[,OPACITY]: in data units, and above 0 to 1");
  }
  options.surface.veil.shown = true;
  options.surface.veil.isovalue = n[0];
  if (n.size() == 2) options.surface.veil.opacity = n[1];
}

void TakeColors(const Texts& texts, Options& options) {
  if (texts.color) {
    const std::vector<double> n = Numbers(*texts.color, 3, 3);
    if (!Within(n, 0.0, 255.0))
      RefuseOption("--color", *texts.color, "RED,GREEN,BLUE, each 0 to 255");
    options.surface.color = Eigen::Vector3d(n[0], n[1], n[2]).cast<float>() / 255.0f;
  }
  for (std::size_t i = 0; i < kColorMapNames.size(); ++i) {
    if (kColorMapNames[i] == texts.color_map) options.surface.color_map = static_cast<ColorMap>(i);
  }
  if (texts.coloring == "height") options.surface.coloring = SurfaceColoring::kHeight;
  if (texts.coloring == "slope") options.surface.coloring = SurfaceColoring::kSlope;
  if (texts.window) {
    const std::vector<double> n = Numbers(*texts.window, 2, 2);
    if (n.empty() || n[0] >= n[1])
      RefuseOption("--window", *texts.window, "LEAST,GREATEST in data units");
    options.window = Eigen::Vector2d(n[0], n[1]);
  }
}

void TakeCrop(const Text& text, Options& options) {
  if (!text) return;
  const std::vector<double> n = Numbers(*text, 6, 6);
  if (!Within(n, 0.0, 1.0) || n[0] >= n[1] || n[2] >= n[3] || n[4] >= n[5]) {
    RefuseOption("--crop", *text,
                 "X0,X1,Y0,Y1,Z0,Z1: shares of the volume, 0 to 1, each pair rising");
  }
  options.surface.crop = {.min = {n[0], n[2], n[4]}, .max = {n[1], n[3], n[5]}};
}

void TakeTexts(const Texts& texts, Options& options) {
  TakeSize(texts.size, options);
  TakeTarget(texts.target, options);
  TakeCamera(texts.camera, options);
  TakeVeil(texts.veil, options);
  TakeColors(texts, options);
  TakeCrop(texts.crop, options);
  options.overlay.box = !texts.no_box;
  options.overlay.letters = !texts.no_letters;
  if (texts.neurological) options.slice_side = SliceSide::kNeurological;
  options.overlay.stylus = !texts.no_stylus && !texts.no_overlay;
  options.overlay.points = options.overlay.force = !texts.no_overlay;
  options.panels = !options.offscreen || texts.panels;
}

void RefuseCombinations(const Options& options, const Texts& texts) {
  const std::string suffix = std::filesystem::path(options.screenshot).extension();
  if (!suffix.empty() && suffix != ".png" && suffix != ".PNG") {
    throw arguments::UsageError("--screenshot writes PNG: '" + options.screenshot +
                                "' must end in .png");
  }
  if (options.offscreen) {
    if (options.screenshot.empty() && options.frames == 0 && options.seconds == 0.0) {
      throw arguments::UsageError("--offscreen needs --screenshot, --frames or --seconds");
    }
    return;
  }
  const auto only_offscreen = [](bool given, const char* name, const char* instead) {
    if (given) throw arguments::UsageError(fmt::format("{} needs --offscreen{}", name, instead));
  };
  only_offscreen(!options.screenshot.empty(), "--screenshot", "; in a window press F12");
  only_offscreen(options.frames != 0, "--frames", "; a window takes --seconds");
  only_offscreen(options.wait_contact, "--wait-contact", "");
  only_offscreen(options.wait_gap_mm > 0.0, "--wait-gap", "");
  only_offscreen(texts.panels, "--panels", "; a window has them");
}

void AddScript(arguments::Command& app, Options& options, Texts& texts) {
  const char* group = "Without a window";
  app.add_flag("--offscreen", options.offscreen, "Draw without a window or a display")
      ->group(group);
  app.add_option("--screenshot", options.screenshot,
                 "Write the last frame into this PNG file, when the volume is complete")
      ->option_text("FILE.png")
      ->group(group);
  app.add_flag("--overwrite", options.overwrite, "Replace a PNG file that is there")->group(group);
  arguments::Option* frames =
      app.add_option("--frames", options.frames, "Draw so many [default: 1]")
          ->option_text("N")
          ->check(arguments::Range(1, 1000000))
          ->group(group);
  arguments::Option* contact =
      app.add_flag("--wait-contact", options.wait_contact,
                   "Draw first when the stylus touches, and show that moment")
          ->group(group);
  app.add_option("--wait-gap", options.wait_gap_mm, "The same, with SCP_H and SCP_V so far apart")
      ->option_text("MM")
      ->check(arguments::Range(0.0, 10.0))
      ->needs(contact)
      ->group(group);
  app.add_flag("--panels", texts.panels, "With the window's panels")->group(group);
  app.add_option("--seconds", options.seconds, "End after this time, s [default: none]")
      ->option_text("S")
      ->check(arguments::Range(0.001, 1e6))
      ->excludes(frames);
  app.add_option("--size", texts.size, "Pixels [default: 1280x800]")->option_text("WxH");
  app.add_option("--graphics-memory-mib", options.graphics_memory_mib,
                 "The most graphics memory for the volume, MiB, 1 to 1048576; what does not\n"
                 "fit is drawn coarser where it is far [default: 1024]")
      ->option_text("MIB")
      ->check(arguments::Range(1, 1048576));
}

void AddView(arguments::Command& app, Options& options, Texts& texts) {
  const char* group = "View";
  const auto add = [&](const char* name, auto& text, const char* form, const char* about) {
    return app.add_option(name, text, about)->option_text(form)->group(group);
  };
  add("--camera", texts.camera, "SIDE|AZ,EL[,MM]|profile,MM",
      "The patient's side to look at: anterior, posterior, left, right, superior,\n"
      "inferior; or degrees about the device's vertical, from the front to the right,\n"
      "and above it, and mm of the device; or profile: along the surface at the proxy\n"
      "[default: all in view, a patient from anterior, other things at 30,20]");
  add("--target", texts.target, "X,Y,Z|scp|volume",
      "Look at a point in mm of the device (x right, y up, z to the user),\n"
      "at the proxy, or at the volume's middle [default: volume]");
  add("--veil", texts.veil, "ISOVALUE[,OPACITY]",
      "A second, translucent surface: data units within the volume's range, 0 to 1\n"
      "[default opacity: 0.3]");
  add("--color", texts.color, "R,G,B", "Colour of the surface, each 0 to 255");
  const std::vector<std::string> maps(kColorMapNames.begin(), kColorMapNames.end());
  add("--color-map", texts.color_map, "NAME",
      "Of cuts, slices and coloring: gray, bone, hot, viridis, cool-warm [default: gray]")
      ->check(arguments::IsMember(maps));
  add("--coloring", texts.coloring, "HOW",
      "The surface by plain, height (along the volume's z), slope [default: plain]")
      ->check(arguments::IsMember(std::vector<std::string>{"plain", "height", "slope"}));
  add("--window", texts.window, "LEAST,GREATEST",
      "Ends of the colour map, data units [default: the volume's range]");
  add("--crop", texts.crop, "X0,X1,Y0,Y1,Z0,Z1",
      "Keep this box: shares of the volume along its axes, 0 to 1");
  const auto add_flag = [&](const char* name, bool& given, const char* about) {
    app.add_flag(name, given, about)->group(group);
  };
  add_flag("--haptic-surface", options.overlay.haptic_surface,
           "Wireframe of the surface that is felt, near the proxy");
  add("--haptic-surface-radius", options.overlay.haptic_surface_radius_voxels,
      "VOXELS [default: 5]", "So far from the proxy, in voxels, 1 to 20")
      ->check(arguments::Range(1.0, 20.0));
  add_flag("--neurological", texts.neurological,
           "Slices with the patient's left at the left [default: at the right,\n"
           "as radiologists have it]");
  add_flag("--no-letters", texts.no_letters,
           "Without L, R, A, P, S, I beside the box and at the slices' edges");
  add_flag("--no-box", texts.no_box, "Without the volume's edges and their letters");
  add_flag("--no-stylus", texts.no_stylus, "Without the stylus");
  add_flag("--no-overlay", texts.no_overlay, "Without stylus, points and force");
}

}  // namespace

std::optional<Options> ParseOptions(int argc, char** argv) {
  Options options;
  Texts texts;
  arguments::Command app(
      "Shows what palpated makes felt: the isosurface, the stylus and the forces.", "palpate-view");
  app.footer(
      "Isovalue and feel are palpated's: what is changed here is changed for everyone.\n"
      "Keys: F1 in the window lists them; Esc is the emergency stop of all forces.\n"
      "Exit codes: as palpate's; 0 done, 2 wrong usage, 3 wrong value, 8 palpated or a display\n"
      "unavailable, 10 something is missing.\n"
      "Example: palpate-view --offscreen --screenshot head.png --camera 30,10 --veil -200,0.25");
  app.set_version_flag("--version", std::string("palpate-view ") + PALPATE_VERSION);
  client::AddServerOptions(app, options.server);
  AddScript(app, options, texts);
  AddView(app, options, texts);
  try {
    if (!app.parse(argc, argv)) return {};
    TakeTexts(texts, options);
    RefuseCombinations(options, texts);
  } catch (const arguments::UsageError& error) {
    throw arguments::UsageError(std::string(error.what()) + "; see --help");
  }
  return options;
}

}  // namespace palpate::view
