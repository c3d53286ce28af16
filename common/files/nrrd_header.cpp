#include "common/files/nrrd_header.h"

#include <bit>
#include <charconv>

namespace palpate {
namespace {

static_assert(std::endian::native == std::endian::little, "the header says so");

// Uses the fewest digits that read back as the same number.
std::string Text(double value) {
  char digits[32];
  return {digits, std::to_chars(digits, std::end(digits), value).ptr};
}
std::string Text(const Vec3& v) {
  return "(" + Text(v.x()) + "," + Text(v.y()) + "," + Text(v.z()) + ")";
}

// Line ends would end the field, and quotes the quoted text.
std::string Quotable(std::string text) {
  std::erase_if(text, [](unsigned char c) { return c < 0x20 || c == 0x7f || c == '"'; });
  return text;
}

}  // namespace

std::string ToText(const NrrdHeader& header) {
  const Mat3& linear = header.X_WI.linear;
  std::string text = "NRRD0005\ntype: " + header.type + "\ndimension: 3\n" +
                     (header.is_lps ? "space: left-posterior-superior" : "space dimension: 3") +
                     "\nsizes:";
  for (const int count : header.size) text += " " + std::to_string(count);
  text += "\nspace directions:";
  for (int axis = 0; axis < 3; ++axis) text += " " + Text(linear.col(axis));
  text += "\nkinds: domain domain domain\nendian: little\nencoding: " + header.encoding +
          "\nspace units: \"mm\" \"mm\" \"mm\"\nspace origin: " + Text(header.X_WI.translation) +
          "\n";
  const std::string unit = Quotable(header.unit);
  if (!unit.empty()) text += "sample units: \"" + unit + "\"\n";
  return text + "\n";
}

}  // namespace palpate
