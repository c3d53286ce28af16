#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <vector>

#include "client/view/drawing/readout.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

struct Plotted {
  Plot plot;
  const char* name;
  const char* unit;
  int digits;  // after the point
  const char* tip;
};

constexpr std::array<Plotted, kPlots> kPlotted = {{
    {Plot::kForce_n, "Force", "N", 2, "the force on the hand, its length"},
    {Plot::kPenetration_mm, "Depth", "mm", 2,
     "how far the stylus tip (HIP) is from the proxy (SCP_H), in contact, in mm of the volume"},
    {Plot::kUpdate_us, "Update", "\xC2\xB5s", 1,
     "the time that the haptic loop computes in a tick, of 1000 \xC2\xB5s"},
    {Plot::kMissedTicks, "Missed ticks", "", 0, "ticks that came too late, since the last pose"},
    {Plot::kStreamAge_ms, "Stream age", "ms", 1, "how old a pose is when it comes here"},
}};

// What is plotted, of one unit of the history: lengths are those of the volume, as everywhere here.
double UnitOf(const Viewer& viewer, Plot plot) {
  return plot == Plot::kPenetration_mm ? 1.0 / DeviceMmPerMm(viewer.feed().volume()) : 1.0;
}

// If no poses come any more, there is no present value.
std::string NewestOf(const Viewer& viewer, const Plotted& plotted) {
  const LiveFeed& feed = viewer.feed();
  const bool is_live = feed.connection().state == client::ConnectionState::kConnected;
  if (!is_live || feed.silent_s()) return "\xE2\x80\x93";
  return fmt::format("{:.{}f}", UnitOf(viewer, plotted.plot) * feed.plots().Newest(plotted.plot),
                     plotted.digits);
}

// Draws the last 10 seconds by the clock. While no poses came, there is no line.
void DrawCurve(const PlotHistory& plots, Plot plot, std::int64_t end_ns, float top,
               const Area& area) {
  constexpr std::int64_t kGap_ns = 250'000'000;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 max = MaxOf(area);
  const std::span<const float> values = plots.Values(plot);
  const std::span<const std::int64_t> times_ns = plots.Times_ns();
  std::vector<ImVec2> line;
  const auto finish = [&] {
    list.AddPolyline(line.data(), static_cast<int>(line.size()),
                     ImGui::GetColorU32(ImGuiCol_PlotLines), 0, 1.0f);
    line.clear();
  };
  for (std::size_t n = 0; n < values.size(); ++n) {
    const double before = static_cast<double>(end_ns - times_ns[n]) / PlotHistory::kSpan_ns;
    if (n > 0 && times_ns[n] - times_ns[n - 1] > kGap_ns) finish();
    line.push_back({max.x - static_cast<float>(std::min(before, 1.0)) * area.size.x,
                    max.y - 1.0f - std::min(values[n] / top, 1.0f) * (area.size.y - 2.0f)});
  }
  finish();
}

void TextAt(const ImVec2& at, const std::string& text, ImU32 color) {
  ImGui::GetWindowDrawList()->AddText(at, color, text.c_str());
}

// Draws lines at 0, half and the end of the scale, and the numbers beside them.
void DrawAxes(const Area& area, float top) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 max = MaxOf(area);
  const ImU32 grid = ImGui::GetColorU32(ImGuiCol_Header);
  const float height = ImGui::GetTextLineHeight();
  list.AddRectFilled(area.min, max, ImGui::GetColorU32(ImGuiCol_FrameBg));
  for (const float share : {0.0f, 0.5f, 1.0f}) {
    const float y = max.y - share * area.size.y;
    list.AddLine({area.min.x, y}, {max.x, y}, grid);
    const std::string value =
        top < 1000.0f ? fmt::format("{:.3g}", share * top) : fmt::format("{:.0f}", share * top);
    TextAt({area.min.x - ImGui::CalcTextSize(value.c_str()).x - 4.0f, y - 0.5f * height}, value,
           kDim.u32());
    const float x = area.min.x + share * area.size.x;
    list.AddLine({x, area.min.y}, {x, max.y}, grid);
    const std::string at_s =
        fmt::format("{:.0f}{}", (share - 1.0f) * static_cast<float>(PlotHistory::kSpan_ns) * 1e-9f,
                    share == 1.0f ? " s" : "");
    const float width = ImGui::CalcTextSize(at_s.c_str()).x;
    TextAt({x - share * width, max.y + 1.0f}, at_s, kDim.u32());
  }
}

void DrawPlot(const Viewer& viewer, const Plotted& plotted, const ImVec2& size, float scale) {
  const PlotHistory& plots = viewer.feed().plots();
  const ImVec2 min = ImGui::GetCursorScreenPos();
  ImGui::Dummy(size);
  Tip(plotted.tip);
  const float height = ImGui::GetTextLineHeight();
  const std::string title = fmt::format("{}{}{}  {}", plotted.name, *plotted.unit ? ", " : "",
                                        plotted.unit, NewestOf(viewer, plotted));
  ImGui::PushClipRect(min, {min.x + size.x, min.y + size.y}, true);
  TextAt(min, title, kPlain.u32());
  const float left = 36.0f * scale;
  const Area area{
      {min.x + left, min.y + 1.5f * height},
      {std::max(1.0f, size.x - left - 8.0f * scale), std::max(1.0f, size.y - 2.7f * height)}};
  const auto unit = static_cast<float>(UnitOf(viewer, plotted.plot));
  const float top = AxisTop(unit * plots.Greatest(plotted.plot));
  DrawAxes(area, top);
  DrawCurve(plots, plotted.plot, viewer.feed().plots_end_ns(), top / unit, area);
  ImGui::PopClipRect();
}

// The newest numbers are readable while the drawer is closed.
void DrawBar(Viewer& viewer, const Layout& layout, bool shown) {
  const Area& area = layout.drawer_bar;
  const float gap = ImGui::GetStyle().ItemSpacing.x;
  BeginPanel("plots bar", area, ImGuiWindowFlags_NoScrollWithMouse);
  ImGui::SetCursorPos({gap, 0.5f * (area.size.y - ImGui::GetFrameHeight())});
  if (ImGui::Button(shown ? "Hide plots (D)" : "Show plots (D)"))
    viewer.preferences().plots_shown = !shown;
  Tip("force, depth and the health of the loop over the last 10 seconds");
  if (const auto silent_s = viewer.feed().silent_s()) {
    ImGui::SameLine(0.0f, 2.0f * gap);
    ImGui::TextColored(kBad, "no poses for %.1f s", *silent_s);
  } else if (!shown) {
    for (const Plotted& plotted : kPlotted) {
      const std::string text =
          fmt::format("{} {} {}", plotted.name, NewestOf(viewer, plotted), plotted.unit);
      ImGui::SameLine(0.0f, 2.0f * gap);
      // Only whole ones.
      if (ImGui::CalcTextSize(text.c_str()).x > ImGui::GetContentRegionAvail().x) break;
      ImGui::TextColored(kDim, "%s", text.c_str());
      Tip(plotted.tip);
    }
  }
  ImGui::End();
}

}  // namespace

void DrawPlots(Viewer& viewer, const Layout& layout, float scale) {
  const Area& area = layout.drawer;
  const bool shown = area.size.y > 0.0f;
  DrawBar(viewer, layout, shown);
  if (!shown) return;
  BeginPanel("plots", area, ImGuiWindowFlags_NoScrollWithMouse);
  const float gap = 6.0f * scale;
  const ImVec2 room = ImGui::GetContentRegionAvail();
  const float width = (room.x - gap * (kPlots - 1)) / kPlots;
  for (const Plotted& plotted : kPlotted) {
    if (plotted.plot != kPlotted.front().plot) ImGui::SameLine(0.0f, gap);
    DrawPlot(viewer, plotted, {width, room.y}, scale);
  }
  ImGui::End();
}

}  // namespace palpate::view
