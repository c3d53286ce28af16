// Fig. 9: drift from a cylinder's isovalue, as a table and a plot.
#include <algorithm>
#include <sstream>

#include "server/lab/drift.h"
#include "server/lab/experiment_parts.h"

namespace palpate::lab {
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

}  // namespace palpate::lab
