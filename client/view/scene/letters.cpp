#include "client/view/scene/letters.h"

#include <string_view>

namespace palpate::view {
namespace {

constexpr std::array<std::uint8_t, 4> kLetterColor = {235, 238, 245, 255};

// Corners of strokes, as digits x and y, on a grid of 4 by 6 from the lower left corner.
std::string_view StrokesOf(char letter) {
  switch (letter) {
    case 'L':
      return "06 00 40";
    case 'R':
      return "00 06 36 45 44 33 03/23 40";
    case 'A':
      return "00 26 40/12 32";
    case 'P':
      return "00 06 36 45 44 33 03";
    case 'S':
      return "45 36 16 05 04 13 33 42 41 30 10 01";
    case 'I':
      return "20 26/10 30/16 36";
    default:
      return "";
  }
}

void AddLetter(char letter, const Vec3& center_D, const Vec3& right_D, const Vec3& up_D,
               Overlay& overlay) {
  const std::string_view strokes = StrokesOf(letter);
  const auto corner = [&](std::size_t at) -> LineVertex {
    const double x = (strokes[at] - '0' - 2) / 6.0;
    const double y = (strokes[at + 1] - '0' - 3) / 6.0;
    return {(center_D + x * right_D + y * up_D).cast<float>(), kLetterColor};
  };
  for (std::size_t at = 3; at < strokes.size(); at += 3) {
    if (strokes[at - 1] == '/') continue;
    overlay.lines.push_back(corner(at - 3));
    overlay.lines.push_back(corner(at));
  }
}

}  // namespace

void AddLetters(std::string_view letters, const Vec3& center_D, const Vec3& right_D,
                const Vec3& up_D, Overlay& overlay) {
  constexpr double kApart = 0.9;  // of the height
  double aside = -0.5 * kApart * static_cast<double>(letters.size() - 1);
  for (const char letter : letters) {
    AddLetter(letter, center_D + aside * right_D, right_D, up_D, overlay);
    aside += kApart;
  }
}

}  // namespace palpate::view
