#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
void DrawSeriesBar(Viewer& viewer, const Area& area) {
  LiveFeed& feed = viewer.feed();
  client::SeriesState series = *feed.series();
  BeginPanel("series", area);
  ImGui::BeginDisabled(!feed.May(client::Role::kEditor));
  if (ImGui::Button(series.playing ? "Pause" : "Play",
                    {ImGui::CalcTextSize("Pause").x + 16.0f, 0.0f})) {
    feed.ControlSeries({.playing = !series.playing});
  }
  Tip("the time series, for everyone");
  ImGui::SameLine();
  const double last = series.frames > 0 ? static_cast<double>(series.frames - 1) : 0.0;
  ImGui::SetNextItemWidth(0.34f * area.size.x);
  // Counted from 0, as in other clients: the last frame is one less than the number of frames.
  const std::string format = "at %.1f of 0 to " + std::to_string(static_cast<int>(last));
  if (HeldSlider(viewer, "##position", series.position_frames, 0.0, last, format.c_str())) {
    feed.ControlSeries({.position_frames = series.position_frames});
  }
  Tip("the frame that is shown and felt");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(0.16f * area.size.x);
  if (HeldSlider(viewer, "##rate", series.rate_hz, -30.0, 30.0, "%.1f /s")) {
    feed.ControlSeries({.rate_hz = series.rate_hz});
  }
  Tip("frames per second, negative backwards");
  ImGui::SameLine();
  if (HeldCheckbox(viewer, "Loop", series.loop)) feed.ControlSeries({.loop = series.loop});
  Tip("begin anew after the last frame");
  ImGui::SameLine();
  if (HeldCheckbox(viewer, "Blend", series.interpolate)) {
    feed.ControlSeries({.interpolate = series.interpolate});
  }
  Tip("interpolate between frames");
  ImGui::EndDisabled();
  SharedSign(viewer, "series");
  ImGui::End();
}

}  // namespace palpate::view
