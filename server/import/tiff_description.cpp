#include "server/import/tiff_description.h"

#include <charconv>
#include <cmath>

#include "server/import/image_header.h"

namespace palpate {
namespace {

// The text behind the key, up to `end`; empty if the key is not there.
std::string_view Value(std::string_view text, std::string_view key, char end) {
  const std::size_t at = text.find(key);
  if (at == std::string_view::npos) return {};
  text.remove_prefix(at + key.size());
  return Trim(text.substr(0, text.find(end)));
}

double Number(std::string_view text, double absent) {
  double number = absent;
  std::from_chars(text.data(), text.data() + text.size(), number);
  return std::isfinite(number) ? number : absent;
}

// ImageJ writes the micro sign in Latin-1, or as an escape.
std::optional<double> Millimetres(std::string_view unit) {
  if (unit.empty()) return std::nullopt;
  const bool is_micrometre = unit == "\xb5m" || unit == "\\u00B5m";
  return MillimetresPer(is_micrometre ? "um" : unit);
}

TiffDescription OfImageJ(std::string_view text, double x_per_unit, double y_per_unit) {
  const auto number = [&](std::string_view key, double absent) {
    return Number(Value(text, key, '\n'), absent);
  };
  TiffDescription description;
  description.has_several_channels_or_times =
      number("\nchannels=", 1) != 1 || number("\nframes=", 1) != 1;
  const double images = number("\nimages=", 1);
  if (images > 1 && images < 1e9) description.images = static_cast<std::int64_t>(images);
  const std::optional<double> mm = Millimetres(Value(text, "\nunit=", '\n'));
  const double z = std::abs(number("\nspacing=", 0));
  if (mm && x_per_unit > 0.0 && y_per_unit > 0.0 && z > 0.0) {
    description.spacing_mm = *mm * Vec3(1.0 / x_per_unit, 1.0 / y_per_unit, z);
  }
  return description;
}

TiffDescription OfOme(std::string_view text) {
  TiffDescription description;
  Vec3 spacing_mm;
  for (const char axis : {'C', 'T'}) {
    const std::string key = std::string(" Size") + axis + "=\"";
    if (Number(Value(text, key, '"'), 1) != 1) description.has_several_channels_or_times = true;
  }
  for (int k = 0; k < 3; ++k) {
    const std::string name = std::string(" PhysicalSize") + "XYZ"[k];
    const std::string_view unit = Value(text, name + "Unit=\"", '"');
    const std::optional<double> mm = Millimetres(unit.empty() ? "um" : unit);
    spacing_mm[k] = mm.value_or(0.0) * Number(Value(text, name + "=\"", '"'), 0.0);
  }
  if (spacing_mm.minCoeff() > 0.0) description.spacing_mm = spacing_mm;
  return description;
}

}  // namespace

TiffDescription ParseTiffDescription(std::string_view text, double x_per_unit, double y_per_unit) {
  return text.starts_with("ImageJ=") ? OfImageJ(text, x_per_unit, y_per_unit) : OfOme(text);
}

}  // namespace palpate
