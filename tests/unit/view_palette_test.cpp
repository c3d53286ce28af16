// Texts are readable in both themes.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "client/view/viewer/theme.h"

namespace palpate::view {
namespace {

// Level AA of the Web Content Accessibility Guidelines for text of this size.
constexpr double kReadable = 4.5;

double Luminance(const ImVec4& color) {
  const auto linear = [](float channel) {
    const auto c = static_cast<double>(channel);
    return c <= 0.03928 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
  };
  return 0.2126 * linear(color.x) + 0.7152 * linear(color.y) + 0.0722 * linear(color.z);
}

// As the guidelines define it: 1 to 21. Only for colours without alpha.
double ContrastOf(const ImVec4& a, const ImVec4& b) {
  const auto [dark, bright] = std::minmax({Luminance(a), Luminance(b)});
  return (bright + 0.05) / (dark + 0.05);
}

TEST(ViewPalette, ContrastIsThatOfTheGuidelines) {
  const ImVec4 black(0.0f, 0.0f, 0.0f, 1.0f);
  const ImVec4 white(1.0f, 1.0f, 1.0f, 1.0f);
  EXPECT_NEAR(ContrastOf(black, white), 21.0, 1e-6);
  EXPECT_NEAR(ContrastOf(white, black), 21.0, 1e-6);
  EXPECT_NEAR(ContrastOf(white, white), 1.0, 1e-9);
  // The gray that is known as the palest one on white.
  const float gray = 118.0f / 255.0f;
  EXPECT_NEAR(ContrastOf({gray, gray, gray, 1.0f}, white), 4.54, 0.01);
}

TEST(ViewPalette, TextsAreReadableOnAllGrounds) {
  for (const Theme theme : {Theme::kDark, Theme::kLight}) {
    const Palette& palette = PaletteOf(theme);
    const std::array grounds = {palette.ground, palette.field, palette.popup, palette.histogram};
    const std::array texts = {palette.text,    palette.dim, palette.good,
                              palette.warning, palette.bad, palette.suggestion};
    for (std::size_t ground = 0; ground < grounds.size(); ++ground) {
      for (std::size_t text = 0; text < texts.size(); ++text) {
        EXPECT_GE(ContrastOf(texts[text], grounds[ground]), kReadable)
            << "theme " << static_cast<int>(theme) << " text " << text << " ground " << ground;
      }
    }
    for (const ImVec4& control : {palette.header, palette.button, palette.hovered, palette.active})
      EXPECT_GE(ContrastOf(palette.text, control), kReadable) << static_cast<int>(theme);
    // A line over the picture, be that black or white.
    for (const float behind : {0.0f, 1.0f}) {
      const auto over = [&](float c) {
        return palette.message.w * c + (1.0f - palette.message.w) * behind;
      };
      const ImVec4 ground(over(palette.message.x), over(palette.message.y), over(palette.message.z),
                          1.0f);
      for (const ImVec4& text : {palette.text, palette.good, palette.warning, palette.bad})
        EXPECT_GE(ContrastOf(text, ground), kReadable) << static_cast<int>(theme) << behind;
    }
  }
}

// Marks of graphs: 3 is enough for what is no text.
TEST(ViewPalette, MarksAreVisible) {
  for (const Theme theme : {Theme::kDark, Theme::kLight}) {
    const Palette& palette = PaletteOf(theme);
    EXPECT_GE(ContrastOf(palette.isovalue, palette.histogram), 3.0) << static_cast<int>(theme);
    EXPECT_GE(ContrastOf(palette.material, palette.histogram), 3.0) << static_cast<int>(theme);
    EXPECT_GE(ContrastOf(palette.line, palette.field), 3.0) << static_cast<int>(theme);
  }
}

}  // namespace
}  // namespace palpate::view
