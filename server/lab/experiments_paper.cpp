// The measurements of the paper, beside ours.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <sstream>

#include "server/lab/accuracy.h"
#include "server/lab/cell_view.h"
#include "server/lab/commands.h"
#include "server/lab/drift.h"
#include "server/lab/experiments.h"
#include "server/lab/published_table.h"
#include "server/lab/trajectory.h"
#include "server/lab/wilcoxon.h"

namespace palpate::lab {

// Tables 1 and 4: R_D of the four methods.

namespace {

struct Measured {
  std::vector<PublishedRow> rows;
  std::array<std::vector<double>, kMethodCount> difference;  // per method and row
};

Measured Measure(const ExperimentOptions& options) {
  Measured measured{ReadPublishedTable(options.table), {}};
  for (const PublishedRow& row : measured.rows) {
    for (int m = 0; m < kMethodCount; ++m) {
      const auto method = static_cast<ComparedMethod>(m);
      measured.difference[m].push_back(
          DifferenceOf(DensitiesFor(row, method), row.isovalue, method, options.columns,
                       method == ComparedMethod::kTpbcc ? options.refinement : 1));
    }
  }
  return measured;
}

double Mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (double value : values) sum += value;
  return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
}

}  // namespace

void PrintTable4(const ExperimentOptions& options, std::ostream& out) {
  const Measured measured = Measure(options);
  Print(out,
        "Table 4: R_D in %% of the cell, %d x %d columns; published, then ours.\n"
        "* differs by more than 0.15 and 2 %%, tptd by more than 0.3\n\n"
        "case     tau   |   bcc           |  tptd           |  tpbcc-published |  tpbcc\n",
        options.columns, options.columns);
  std::array<int, 3> met{}, given{};
  for (std::size_t r = 0; r < measured.rows.size(); ++r) {
    const PublishedRow& row = measured.rows[r];
    Print(out, "%-8s %.2f  |", row.name.c_str(), row.isovalue);
    for (int m = 0; m < 3; ++m) {
      const double ours = measured.difference[m][r];
      if (!row.difference[m]) {
        Print(out, "     -  %6.2f   |", ours);
        continue;
      }
      const bool meets = MeetsPublished(static_cast<ComparedMethod>(m), *row.difference[m], ours);
      ++given[m];
      met[m] += meets;
      Print(out, " %6.2f %6.2f %c |", *row.difference[m], ours, meets ? ' ' : '*');
    }
    Print(out, "   %6.2f\n", measured.difference[3][r]);
  }
  Print(out, "\nmet: bcc %d of %d, tptd %d of %d, tpbcc-published %d of %d\n", met[0], given[0],
        met[1], given[1], met[2], given[2]);
  int best = 0;
  for (std::size_t r = 0; r < measured.rows.size(); ++r) {
    const auto& all = measured.difference;
    best += all[3][r] < std::min({all[0][r], all[1][r], all[2][r]});
  }
  Print(out, "tpbcc, cells cut into %d^3: the least of all in %d of %zu, mean %.3f\n",
        options.refinement, best, measured.rows.size(), Mean(measured.difference[3]));
}

void PrintTable1(const ExperimentOptions& options, std::ostream& out) {
  const Measured measured = Measure(options);
  Print(out, "Table 1: mean R_D in %% of the cell over %zu cells\n\n%-16s %8s %22s %10s\n",
        measured.rows.size(), "method", "ours", "ours, published rows", "published");
  for (int m = 0; m < kMethodCount; ++m) {
    Print(out, "%-16s %8.3f", kMethodNames[m].data(), Mean(measured.difference[m]));
    // Compares only the rows for which the paper has a figure.
    std::vector<double> published, ours;
    for (std::size_t n = 0; n < measured.rows.size(); ++n) {
      const PublishedRow& row = measured.rows[n];
      if (m >= 3 || !row.difference[m]) continue;
      published.push_back(*row.difference[m]);
      ours.push_back(measured.difference[m][n]);
    }
    if (m < 3) {
      Print(out, " %22.3f %10.3f (%zu)", Mean(ours), Mean(published), published.size());
    }
    out << "\n";
  }
  Print(out, "\nWilcoxon's signed-rank test, two-sided: W+ where the first has the larger R_D\n");
  for (int a = 0; a < kMethodCount; ++a) {
    for (int b = a + 1; b < kMethodCount; ++b) {
      const SignedRankResult test = SignedRankTest(measured.difference[a], measured.difference[b]);
      Print(out, "%-16s %-16s pairs %2d  W+ %6.1f  W- %6.1f  p %.4f%s\n", kMethodNames[a].data(),
            kMethodNames[b].data(), test.pairs, test.w_plus, test.w_minus, test.p_value,
            test.exact ? " (exact)" : "");
    }
  }
}

// Fig. 11: the cells of Table 4 as an SVG sheet, with V beside H for each method.

namespace {

const CellView kView{120};
constexpr int kSubdivision = 8;  // parts of a cell per axis, to draw V

struct Polygon {
  std::array<Vec3, 4> corner;
  int corners = 0;
};

// H within a tetrahedron: a triangle or a quadrilateral.
Polygon Cut(const Decomposition& cell, const std::array<std::uint8_t, 4>& v, double isovalue) {
  std::array<int, 4> above, below;
  int above_count = 0, below_count = 0;
  for (int vertex : v) {
    if (cell.density[vertex] > isovalue) {
      above[above_count++] = vertex;
    } else {
      below[below_count++] = vertex;
    }
  }
  Polygon polygon;
  const auto add = [&](int a, int b) {
    const double t = (isovalue - cell.density[a]) / (cell.density[b] - cell.density[a]);
    polygon.corner[polygon.corners++] =
        cell.position[a] + t * (cell.position[b] - cell.position[a]);
  };
  for (int a = 0; a < above_count; ++a) {
    // Goes round the quadrilateral, so the second row is in reverse order.
    for (int b = 0; b < below_count; ++b) {
      add(above[a], below[above_count == 2 && a == 1 ? below_count - 1 - b : b]);
    }
  }
  return polygon;
}

void AddSurface(const CellDensities& d, double isovalue, ComparedMethod method, const Vec3& origin,
                double edge, std::vector<Polygon>& polygons) {
  const Decomposition cell = Decompose(d, method);
  for (int t = 0; t < cell.complex.tetrahedron_count; ++t) {
    Polygon polygon = Cut(cell, cell.complex.vertices[t], isovalue);
    for (int n = 0; n < polygon.corners; ++n) {
      polygon.corner[n] = origin + edge * polygon.corner[n];
    }
    if (polygon.corners >= 3) polygons.push_back(polygon);
  }
}

std::vector<Polygon> VisualSurface(const CellDensities& d, double isovalue) {
  const Trilinear f(d);
  std::vector<Polygon> polygons;
  const double edge = 1.0 / kSubdivision;
  for (int n = 0; n < kSubdivision * kSubdivision * kSubdivision; ++n) {
    const Vec3 origin = edge * Vec3(n / (kSubdivision * kSubdivision),
                                    n / kSubdivision % kSubdivision, n % kSubdivision);
    CellDensities part;
    for (int v = 0; v < 8; ++v) {
      const auto& o = kCornerOffset[v];
      part[v] = f.Value(origin + edge * Vec3(o[0], o[1], o[2]));
    }
    if (IsCrossed(part, isovalue)) {
      AddSurface(part, isovalue, ComparedMethod::kTptd, origin, edge, polygons);
    }
  }
  return polygons;
}

// Draws from back to front, shaded by the angle between the normal and the eye.
void DrawSurface(std::vector<Polygon> polygons, bool outlined, std::ostream& svg) {
  const auto depth = [](const Polygon& p) {
    double sum = 0.0;
    for (int n = 0; n < p.corners; ++n) sum += kView.to_eye.dot(p.corner[n]);
    return sum / p.corners;
  };
  std::sort(polygons.begin(), polygons.end(),
            [&](const Polygon& a, const Polygon& b) { return depth(a) < depth(b); });
  for (const Polygon& polygon : polygons) {
    const Vec3 normal = (polygon.corner[1] - polygon.corner[0])
                            .cross(polygon.corner[2] - polygon.corner[0])
                            .normalized();
    const int light = static_cast<int>(80 + 150 * std::abs(normal.dot(kView.to_eye)));
    char colour[16];
    std::snprintf(colour, sizeof colour, "#%02x%02x%02x", outlined ? light : light * 3 / 4,
                  light * 7 / 8, outlined ? light * 3 / 5 : light);
    svg << "<path fill='" << colour << "' stroke='" << (outlined ? "#333" : colour)
        << "' stroke-width='0.4' d='";
    for (int n = 0; n < polygon.corners; ++n) {
      svg << (n == 0 ? "M" : "L") << kView.PixelX(polygon.corner[n]) << " "
          << kView.PixelY(polygon.corner[n]);
    }
    svg << "Z'/>\n";
  }
}

void DrawPanel(double x, double y, const std::string& label, const std::vector<Polygon>& polygons,
               bool outlined, std::ostream& svg) {
  svg << "<g transform='translate(" << x << " " << y << ")'>\n";
  DrawEdges(kView, svg);
  DrawSurface(polygons, outlined, svg);
  svg << "<text x='4' y='10'>" << label << "</text></g>\n";
}

}  // namespace

void PrintFigure11(const ExperimentOptions& options, std::ostream& out) {
  const std::vector<PublishedRow> rows = ReadPublishedTable(options.table);
  constexpr int kPanels = 1 + static_cast<int>(kMethodNames.size());
  const double width = kPanels * kView.panel,
               height = static_cast<double>(rows.size()) * kView.panel;
  std::ostringstream svg;
  svg.precision(5);
  svg << "<svg xmlns='http://www.w3.org/2000/svg' width='" << width << "' height='" << height
      << "' font-family='sans-serif' font-size='9'>\n<rect width='100%' height='100%' "
         "fill='white'/>\n";
  double y = 0.0;
  for (const PublishedRow& row : rows) {
    DrawPanel(0.0, y, "V " + row.name, VisualSurface(row.d, row.isovalue), false, svg);
    for (int m = 0; m + 1 < kPanels; ++m) {
      std::vector<Polygon> polygons;
      const auto method = static_cast<ComparedMethod>(m);
      AddSurface(DensitiesFor(row, method), row.isovalue, method, Vec3::Zero(), 1.0, polygons);
      DrawPanel((m + 1) * kView.panel, y, std::string(kMethodNames[m]), polygons, true, svg);
    }
    y += kView.panel;
  }
  svg << "</svg>\n";
  Print(out, "Fig. 11: V and H by %zu methods for %zu cells\n", kMethodNames.size(), rows.size());
  WriteFigure(options, "figure11.svg", svg.str(), out);
}

// Fig. 9: drift from a cylinder's isovalue, as a table and a plot.

namespace {

constexpr double kWidth = 720, kHeight = 400, kLeft = 70, kRight = 20, kTop = 30, kBottom = 50;
constexpr const char* kColours[] = {"#1b6ca8", "#7fb2d8", "#c0392b", "#e8a838"};

struct Axes {
  double laps, low, high;
  double X(double lap) const { return kLeft + (kWidth - kLeft - kRight) * lap / laps; }
  double Y(double value) const {
    return kTop + (kHeight - kTop - kBottom) * (high - value) / (high - low);
  }
};

void DrawAxes(const Axes& axes, std::ostream& svg) {
  svg << "<rect width='100%' height='100%' fill='white'/>\n"
      << "<text x='" << kLeft
      << "' y='20'>Isovalue at the proxy, cylinder, &#964; = " << kDriftIsovalue << "</text>\n";
  for (int n = 0; n <= 5; ++n) {
    const double value = axes.low + (axes.high - axes.low) * n / 5.0;
    char label[32];
    std::snprintf(label, sizeof label, "%.3f", value);
    svg << "<line x1='" << kLeft << "' x2='" << kWidth - kRight << "' y1='" << axes.Y(value)
        << "' y2='" << axes.Y(value) << "' stroke='#ddd'/><text x='" << kLeft - 8 << "' y='"
        << axes.Y(value) + 4 << "' text-anchor='end'>" << label << "</text>\n";
  }
  const int step = std::max(1, static_cast<int>(axes.laps) / 10);
  for (int lap = 0; lap <= static_cast<int>(axes.laps); lap += step) {
    svg << "<text x='" << axes.X(lap) << "' y='" << kHeight - kBottom + 18
        << "' text-anchor='middle'>" << lap << "</text>\n";
  }
  svg << "<text x='" << kWidth / 2 << "' y='" << kHeight - 12
      << "' text-anchor='middle'>lap</text>\n";
}

std::string Plot(const std::vector<DriftCurve>& curves) {
  Axes axes{static_cast<double>(curves[0].laps.size()), kDriftIsovalue, kDriftIsovalue};
  for (const DriftCurve& curve : curves) {
    const auto [low, high] = std::minmax_element(curve.isovalue.begin(), curve.isovalue.end());
    axes.low = std::min(axes.low, *low);
    axes.high = std::max(axes.high, *high);
  }
  const double margin = 0.05 * (axes.high - axes.low) + 1e-4;
  axes.low -= margin;
  axes.high += margin;
  std::ostringstream svg;
  svg << "<svg xmlns='http://www.w3.org/2000/svg' width='" << kWidth << "' height='" << kHeight
      << "' font-family='sans-serif' font-size='12'>\n";
  DrawAxes(axes, svg);
  for (std::size_t c = 0; c < curves.size(); ++c) {
    const auto& values = curves[c].isovalue;
    svg << "<polyline fill='none' stroke='" << kColours[c % 4] << "' stroke-width='1.5' points='";
    for (std::size_t n = 0; n < values.size(); ++n) {
      svg << axes.X(axes.laps * static_cast<double>(n + 1) / static_cast<double>(values.size()))
          << "," << axes.Y(values[n]) << " ";
    }
    svg << "'/>\n<text x='" << kLeft + 12 << "' y='" << kHeight - kBottom - 12 - 16 * c
        << "' fill='" << kColours[c % 4] << "'>" << curves[c].name << "</text>\n";
  }
  svg << "</svg>\n";
  return svg.str();
}

}  // namespace

void PrintFigure9(const ExperimentOptions& options, std::ostream& out) {
  const std::vector<DriftCurve> curves = MeasureDrift(options.laps);
  Print(out,
        "Fig. 9: isovalue (data units) at the proxy after each lap round builtin:cylinder, tau "
        "%.2f,\nHIP 1 mm deep, 10 cm/s, 1 kHz; F unless said otherwise. GBID: the plane through\n"
        "the proxy, normal to the gradient; corrected: shifted by the value's error.\n\nlap ",
        kDriftIsovalue);
  for (const DriftCurve& curve : curves) Print(out, " %20s", curve.name.c_str());
  for (std::size_t lap = 0; lap < curves[0].laps.size(); ++lap) {
    Print(out, "\n%3zu ", lap + 1);
    for (const DriftCurve& curve : curves) Print(out, " %20.6f", curve.laps[lap].isovalue);
  }
  Print(out, "\nlargest |F - tau|\n    ");
  for (const DriftCurve& curve : curves) {
    double worst = 0.0;
    for (const DriftLap& lap : curve.laps) worst = std::max(worst, lap.worst);
    Print(out, " %20.6f", worst);
  }
  out << "\n";
  WriteFigure(options, "figure9.svg", Plot(curves), out);
}

// Table 3: how long a haptic update takes while a hand explores.

namespace {

struct ExploredVolume {
  const char* name;
  const char* source;  // builtin name, or path below the data folder
  double isovalue;     // normalised, from Table 2
};

// Visible Male and Neuron are not available: a CT head and another neuron replace them.
constexpr ExploredVolume kVolumes[] = {
    {"cylinder", "builtin:cylinder", 0.12},
    {"daisy", "paper/daisy_192x180x168_uint8.nhdr", 0.02},
    {"head (for Visible Male)", "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", 0.33},
    {"lobster", "paper/lobster_301x324x56_uint8.nhdr", 0.16},
    {"neuron (another)", "paper/SUBST_neuron_janelia_511x512x47_uint8.nrrd", 0.12},
    {"orange", "paper/orange_256x256x64_uint8.nhdr", 0.22},
};

struct Resolution {
  const char* name;
  double spacing_mm;
  const char* published_ms;
};
constexpr Resolution kResolutions[] = {{"1 mm = 1/2 cell", 2.0, "0.21-0.35"},
                                       {"1 mm = 3 cells", 1.0 / 3.0, "0.33-0.44"}};

// Mean speed of the HIP in cm/s, without jumps.
double MeanSpeed(const std::vector<Vec3>& hips_mm) {
  constexpr double kFastestMm = 1.0;  // per tick; faster steps are jumps
  constexpr double kCmPerMm = 0.1;
  double way_mm = 0.0;
  int steps = 0;
  for (std::size_t n = 1; n < hips_mm.size(); ++n) {
    const double step_mm = (hips_mm[n] - hips_mm[n - 1]).norm();
    if (step_mm <= kFastestMm) way_mm += step_mm, ++steps;
  }
  return steps > 0 ? way_mm * kCmPerMm / (steps * kReplayPeriodS) : 0.0;
}

void Explore(const ExploredVolume& volume, const Resolution& resolution,
             const ExperimentOptions& options, std::ostream& out) {
  const bool builtin = std::string_view(volume.source).starts_with("builtin:");
  const std::filesystem::path source =
      builtin ? std::filesystem::path(volume.source) : options.data_folder / volume.source;
  if (!builtin && !std::filesystem::exists(source)) {
    Print(out, "%-24s not found; give its folder with --data\n", volume.name);
    return;
  }
  const LoadedSurface loaded = LoadSurface({.volume = source.string(),
                                            .isovalue = volume.isovalue,
                                            .normalized = true,
                                            .spacing_mm = {resolution.spacing_mm}});
  const std::vector<Vec3> hips_mm = MakeTrajectory(
      *loaded.volume,
      {.kind = TrajectoryKind::kFreehand, .isovalue = loaded.isovalue, .seed = options.seed});
  HapticSettings settings;
  settings.refinement = options.refinement;
  const ReplaySummary s =
      ReplayAndJudge(loaded, DecompositionMethod::kTpbcc, settings, hips_mm, 1).summary;
  Print(out, "%-24s %9.5f  %-10s %7.2f %9.1f %6.1f %7d %6d\n", volume.name, s.mean_ns * 1e-6,
        resolution.published_ms, static_cast<double>(s.p99_ns) * 1e-3, MeanSpeed(hips_mm),
        100.0 * s.contact_share(), s.verdict.fall_throughs, *s.verdict.sticks);
}

}  // namespace

void PrintTable3(const ExperimentOptions& options, std::ostream& out) {
  Print(out,
        "Table 3: time of one haptic update while a hand explores for 60 s. Published: Intel i5,\n"
        "3 GHz, stylus at 5 to 19 cm/s, in contact for 63 to 85 %% of the time.\n");
  for (const Resolution& resolution : kResolutions) {
    Print(out, "\n%-24s %9s  %-10s %7s %9s %6s %7s %6s\n", resolution.name, "mean ms", "published",
          "p99 us", "cm/s", "felt%", "through", "stick");
    for (const ExploredVolume& volume : kVolumes) Explore(volume, resolution, options, out);
  }
}

}  // namespace palpate::lab
