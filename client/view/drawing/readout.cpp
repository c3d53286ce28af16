#include "client/view/drawing/readout.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "client/view/drawing/patient_axes.h"

namespace palpate::view {

std::string ValueText(double value, const VolumeLattice& lattice) {
  const bool is_whole = lattice.type != LeafType::kFloat;
  // To a tenth, as whole numbers have no more that is of use.
  const double shown = is_whole ? std::round(10.0 * value) / 10.0 : value;
  const std::string number = fmt::format("{:.{}g}", shown + 0.0, is_whole ? 7 : 5);
  return lattice.unit.empty() ? number : number + " " + lattice.unit;
}

std::string WindowText(double value, double width) {
  return width >= 100.0 ? fmt::format("{:.0f}", std::round(value) + 0.0)
                        : fmt::format("{:.4g}", value);
}

int PlaceDigits::after_point() const {
  return std::clamp(static_cast<int>(std::ceil(-std::log10(voxel_mm))), 1, 9);
}

double PlaceDigits::Rounded(double at_mm) const {
  const double power = std::pow(10.0, after_point());
  return std::round(power * at_mm) / power + 0.0;
}

PlaceDigits PlaceDigitsOf(const AffineMap& X_WI) {
  return {X_WI.linear.colwise().norm().minCoeff()};
}

std::string PlaceText(const Vec3& p_P, bool of_patient, const PlaceDigits& digits) {
  std::string text;
  for (int axis = 0; axis < 3; ++axis) {
    // Rounded first: "R 0.0" and "-0.0" would puzzle.
    const double at = digits.Rounded(p_P[axis]);
    const char name = of_patient ? LetterOf({axis, at < 0.0 ? -1 : 1}) : "xyz"[axis];
    text += fmt::format("{} {:.{}f} ", name, of_patient ? std::abs(at) : at, digits.after_point());
  }
  return text + "mm";
}

double DeviceMmPerMm(const ViewVolume& volume) {
  if (!volume.lattice() || !volume.X_DI()) return 1.0;
  const double det_D = volume.X_DI()->linear.determinant();
  const double det_W = volume.lattice()->X_WI.linear.determinant();
  return std::cbrt(std::abs(det_D / det_W));
}

ScaleBar FitScaleBar(double mm_per_px, double most_px) {
  const double most_mm = mm_per_px * most_px;
  if (!(most_mm > 0.0) || !std::isfinite(most_mm)) return {};
  const double power = std::pow(10.0, std::floor(std::log10(most_mm)));
  double length_mm = power;
  for (const double times : {2.0, 5.0}) {
    if (times * power <= most_mm) length_mm = times * power;
  }
  return {length_mm, length_mm / mm_per_px};
}

std::string TextOf(const ScaleBar& bar) { return fmt::format("{:.6g} mm", bar.length_mm); }

}  // namespace palpate::view
