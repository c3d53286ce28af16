// The colours of the panels, dark and light. The picture, its overlays and the slices are drawn on
// a dark ground in both.
//
// Threads: pure.
#pragma once

#include "client/view/app/preferences.h"

namespace palpate::view {

struct Rgba {
  float r = 0.0f;
  float g = 0.0f;
  float b = 0.0f;
  float a = 1.0f;
};

struct Palette {
  // Grounds.
  Rgba ground;  // of the panels
  Rgba field;   // of controls and plots
  Rgba histogram;
  Rgba header;
  Rgba popup;
  Rgba message;  // under a line over the picture
  // Of buttons, and of what is chosen.
  Rgba button;
  Rgba hovered;
  Rgba active;
  // Texts, readable on all grounds.
  Rgba text;
  Rgba dim;
  Rgba good;
  Rgba warning;
  Rgba bad;
  Rgba suggestion;  // names of isovalues, on the histogram
  // Marks.
  Rgba isovalue;
  Rgba material;    // bars of the histogram that are felt
  Rgba other_bars;  // bars of the histogram that are not
  Rgba line;        // of plots
};

const Palette& PaletteOf(Theme theme);

// As the Web Content Accessibility Guidelines define it: 1 to 21. Only for colours without alpha.
double ContrastOf(const Rgba& a, const Rgba& b);

}  // namespace palpate::view
