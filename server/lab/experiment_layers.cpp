// A stylus presses through skin to bone and comes back: forces as a table and a plot.
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <sstream>

#include "common/error/error.h"
#include "server/haptics/renderer.h"
#include "server/lab/experiments.h"
#include "server/lab/lab_arguments.h"
#include "server/lab/replay.h"

namespace palpate::lab {
namespace {

constexpr const char* kHead = "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd";
constexpr double kSkinHu = -300.0, kBoneHu = 300.0;
constexpr double kSpeedMmPerS = 20.0, kBeforeMm = 4.0, kPressMm = 9.0;
constexpr double kWidthPx = 720, kHeightPx = 340, kLeftPx = 60, kRightPx = 20, kTopPx = 30,
                 kBottomPx = 45;

struct Moment {
  double time_s = 0.0, depth_mm = 0.0, force_n = 0.0;
  int passed = 0, touched = 0;
};

HapticLayers SkinAndBone(const VolumeSnapshot& volume) {
  HapticLayers layers;
  layers.count = 2;
  layers.layer[0] = {.id = 1,
                     .isovalue = volume.Normalize(kSkinHu),
                     .stiffness_n_per_mm = 0.3,
                     .pop_in_n = 1.0,
                     .pop_out_n = 0.4};
  layers.layer[1] = {.id = 2, .isovalue = volume.Normalize(kBoneHu), .stiffness_n_per_mm = 1.0};
  return layers;
}

// The first point above τ on the line from the middle of the lowest y inwards, half way up.
Vec3 FirstAbove(const HapticSurface& surface) {
  CellCache cache;
  const Vec3 size = surface.volume->size().cast<double>();
  const double step_mm = 0.05;
  Vec3 p = surface.X_DI.Apply(Vec3(0.5 * size.x(), 0.0, 0.5 * size.z()));
  const double end_mm = surface.X_DI.Apply(size).y();
  for (; p.y() < end_mm; p.y() += step_mm) {
    double density = 0.0;
    PlaceAt(surface, surface.X_LD.Apply(p), cache, density);
    if (density > surface.isovalue) return p;
  }
  throw Error(ErrorKind::kInvalidArgument, "there is no skin on the line into the head");
}

std::vector<Moment> Press(const HapticSurface& surface, const Vec3& skin_mm) {
  const auto state = std::make_unique<RendererState>();
  const double step_mm = kSpeedMmPerS * kReplayPeriodS;
  const int ticks = static_cast<int>((kBeforeMm + kPressMm) / step_mm);
  std::vector<Moment> moments;
  for (int n = 0; n <= 2 * ticks; ++n) {
    const double depth_mm = step_mm * (n <= ticks ? n : 2 * ticks - n) - kBeforeMm;
    const HapticOutput output =
        StepRenderer(surface, {}, skin_mm + Vec3(0.0, depth_mm, 0.0), kReplayPeriodS, *state);
    moments.push_back({n * kReplayPeriodS, depth_mm, output.force_D_n.norm(), output.layers_passed,
                       output.contact_layer});
  }
  return moments;
}

void PrintPassings(const std::vector<Moment>& moments, std::ostream& out) {
  Print(out, "%-28s %9s %9s %9s\n", "", "time s", "depth mm", "force N");
  for (std::size_t n = 1; n < moments.size(); ++n) {
    const Moment &before = moments[n - 1], &now = moments[n];
    const auto say = [&](const char* what) {
      Print(out, "%-28s %9.3f %9.2f %9.3f\n", what, now.time_s, now.depth_mm, before.force_n);
    };
    if (now.passed > before.passed) say("skin lets the stylus in");
    if (now.passed < before.passed) say("skin lets the stylus out");
    if (now.touched == 2 && before.touched != 2) say("bone is touched");
  }
  const auto most = std::ranges::max_element(moments, {}, &Moment::force_n);
  Print(out, "%-28s %9.3f %9.2f %9.3f\n", "greatest force, on bone", most->time_s, most->depth_mm,
        most->force_n);
}

std::string Plot(const std::vector<Moment>& moments) {
  const double end_s = moments.back().time_s;
  const double most_n = 1.1 * std::ranges::max_element(moments, {}, &Moment::force_n)->force_n;
  const auto x = [&](double s) { return kLeftPx + (kWidthPx - kLeftPx - kRightPx) * s / end_s; };
  const auto y = [&](double n) {
    return kTopPx + (kHeightPx - kTopPx - kBottomPx) * (most_n - n) / most_n;
  };
  std::ostringstream svg;
  svg.precision(5);
  svg << "<svg xmlns='http://www.w3.org/2000/svg' width='" << kWidthPx << "' height='" << kHeightPx
      << "' font-family='sans-serif' font-size='12'>\n<rect width='100%' height='100%' "
         "fill='white'/>\n<text x='"
      << kLeftPx << "' y='20'>Force while a stylus presses into the CT head: skin at " << kSkinHu
      << " HU, bone at " << kBoneHu << " HU</text>\n";
  // Behind the skin.
  for (std::size_t n = 1; n < moments.size(); ++n) {
    if (moments[n].passed == 0) continue;
    std::size_t end = n;
    while (end + 1 < moments.size() && moments[end + 1].passed > 0) ++end;
    svg << "<rect x='" << x(moments[n].time_s) << "' y='" << kTopPx << "' width='"
        << x(moments[end].time_s) - x(moments[n].time_s) << "' height='"
        << kHeightPx - kTopPx - kBottomPx << "' fill='#e69f00' opacity='0.15'/><text x='"
        << x(moments[n].time_s) + 6 << "' y='" << kTopPx + 16 << "'>behind the skin</text>\n";
    n = end + 1;
  }
  for (int n = 0; n <= static_cast<int>(most_n); ++n) {
    svg << "<line x1='" << kLeftPx << "' x2='" << kWidthPx - kRightPx << "' y1='" << y(n)
        << "' y2='" << y(n) << "' stroke='#ddd'/><text x='" << kLeftPx - 8 << "' y='" << y(n) + 4
        << "' text-anchor='end'>" << n << " N</text>\n";
  }
  for (double s = 0.0; s <= end_s; s += 0.2) {
    svg << "<text x='" << x(s) << "' y='" << kHeightPx - kBottomPx + 18 << "' text-anchor='middle'>"
        << s << " s</text>\n";
  }
  svg << "<polyline fill='none' stroke='#1b6ca8' stroke-width='1.5' points='";
  for (const Moment& moment : moments) svg << x(moment.time_s) << "," << y(moment.force_n) << " ";
  svg << "'/>\n</svg>\n";
  return svg.str();
}

}  // namespace

void PrintLayers(const ExperimentOptions& options, std::ostream& out) {
  const std::filesystem::path source = options.data_folder / kHead;
  if (!std::filesystem::exists(source)) {
    throw Error(ErrorKind::kNotFound,
                source.string() + " is not there: give its folder with --data");
  }
  const auto volume = LoadVolume(source.string(), ImportProgramBesideThis());
  const HapticLayers layers = SkinAndBone(*volume);
  HapticSurface surface =
      MakeHapticSurface(*volume, volume->metadata().WorldFromIndex(), layers.layer[0].isovalue,
                        DecompositionMethod::kTpbcc, 1, FreeSide::kBelow, options.refinement);
  const Vec3 skin_mm = FirstAbove(surface);
  surface.layers = &layers;
  const std::vector<Moment> moments = Press(surface, skin_mm);
  PrintPassings(moments, out);
  WriteFigure(options, "layers.svg", Plot(moments), out);
}

}  // namespace palpate::lab
